"""What one client sees and does: its controls, its scene, its pictures, its own press."""

import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from typing import Any

import viser
from viser import _messages

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import CYSKIN_COVER
from t2twin.sim.cyskin.layout import load_layout
from t2twin.sim.cyskin.taxels import pad_weights
from t2twin.sim.digit.calibration import Calibration
from t2twin.studio.controls.drop import take_dropped
from t2twin.studio.controls.export_zip import zipped
from t2twin.studio.controls.notices import Notices
from t2twin.studio.controls.press import MAX_SLIDER_N, MIN_SLIDER_N, QUIET, Controls
from t2twin.studio.controls.translate_tab import TranslateTab
from t2twin.studio.controls.view_options import ViewOptions
from t2twin.studio.press_state import PressState, is_file
from t2twin.studio.session import Look, Session
from t2twin.studio.transport.uploads import forget, kept_file
from t2twin.studio.view.cards import (
    Scales,
    again_html,
    pictures_html,
    scales_of,
    welcome_html,
)
from t2twin.studio.view.scene import Dragged, Scene
from t2twin.studio.warmup import Shared
from t2twin.studio.worker import LatestOnlyWorker
from t2twin.twin import load_shape

DEGREES_A_MM, NEWTONS_A_MM = 4.0, 0.25
"""What a drag to the right with Shift turns, and one downwards with Ctrl presses (assumed)."""

FIRST_START = "The first start on a machine takes some seconds more: what is made then is kept."
"""What is said until the first press is done."""

TURNS = 20
"""Turns of viser's loop within which it sends what is flushed: three times those that it needs."""

SENT_S = 1.0
"""How long they are waited for, s: they take a millisecond unless the studio is being closed."""

CONTROLS_PX, PICTURES_PX = 320, 420
"""Widths of the panels, px."""


class Page:
    """One client's page. Whatever it changes asks the worker for a new look; the worker always
    takes the newest state. controls: its panel. look: what it shows, None at first."""

    def __init__(
        self,
        client: viser.ClientHandle,
        shared: Shared,
        state: PressState,
        link: Callable[[PressState], str],
    ) -> None:
        self._client, self._shared, self._link = client, shared, link
        self._own_folder = shared.folder / str(client.client_id)
        self._lock, self._slow = Lock(), Lock()
        self._state, self._dragged_from, self._force_from = state, state, state.force_n
        self._runs: tuple[str, ...] = ()
        self._session: Session | None = None
        self._loading: Thread | None = None
        self.look: Look | None = None
        self._notices = Notices(client)
        self._loop = client.gui._event_loop
        self._scene = Scene(client, self._drag)
        self._build()
        self._worker = LatestOnlyWorker(self._show_newest, self._settle)
        self.runs_changed()
        self._worker.ask()

    def close(self) -> None:
        """The client is gone, and its files with it."""
        self._worker.end()
        self._tab.close()
        self._shared.uploads.leave(self._client)
        shutil.rmtree(self._own_folder, ignore_errors=True)

    def join(self, timeout_s: float) -> None:
        """Waits until the press that was begun before `close` is done."""
        self._worker.join(timeout_s)

    def wait(self, timeout_s: float) -> bool:
        """Until the page shows its newest state, files and translators and all; False where that
        took longer."""
        until_s = time.monotonic() + timeout_s
        done = self._slow.acquire(timeout=timeout_s)
        if done:
            self._slow.release()
        done = self._worker.wait(max(until_s - time.monotonic(), 0.0)) and done
        if self._loading is not None:
            self._loading.join(max(until_s - time.monotonic(), 0.0))
        return done and self._worker.wait(max(until_s - time.monotonic(), 0.0))

    @property
    def state(self) -> PressState:
        """What is to be shown; `look` follows."""
        return self._state

    @property
    def folder(self) -> Path:
        """For this client's files alone; made with the first of them."""
        self._own_folder.mkdir(exist_ok=True)
        return self._own_folder

    def change(self, changes: dict[str, Any]) -> PressState:
        """Takes fields of PressState with new values, and shows what comes of them."""
        with self._lock:
            self._state = state = self._state.changed(changes)
        self._worker.ask()
        return state

    def runs_changed(self) -> None:
        """Offers the runs that are known by now."""
        names, chosen = self._shared.translators.names, self._shared.translators.chosen
        with self._lock:
            new = [name for name in names if name not in self._run_boxes]
            with self._runs_folder:
                for name in new:
                    box = self._client.gui.add_checkbox(name, name in chosen)
                    box.on_update(self._new_runs)
                    self._run_boxes[name] = box
            self._runs_folder.visible = bool(names)
        if new:
            self._take_runs(chosen)
        else:
            self._worker.ask()  # that there are none is said, too

    async def _new_runs(self, event: viser.GuiEvent) -> None:
        runs = tuple(name for name, box in self._run_boxes.items() if box.value)
        self._notices.guarded(lambda: self._take_runs(runs))

    def _take_runs(self, runs: tuple[str, ...]) -> None:
        self._runs = runs
        self._tab.use(runs)
        self._worker.ask()

    def _build(self) -> None:
        gui = self._client.gui
        self._shared.uploads.enter(self._client, self._notices.wrong)
        gui.set_panel_label("t2twin studio")
        gui.main_panel.dock_left()
        gui.main_panel.set_width(CONTROLS_PX)
        gui.add_html(welcome_html())
        self.controls = Controls(self._client, self._state, self.change, self._notices.guarded)
        self._view = ViewOptions(self._client, self._scene.arrange, lambda: self._worker.ask())
        self._runs_folder = gui.add_folder("Translators", expand_by_default=False, visible=False)
        self._run_boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self._add_take_away()
        pictures = gui.add_panel()
        with pictures.add_tab("Pictures", viser.Icon.PHOTO):
            self._pictures = gui.add_html("")
        with pictures.add_tab("Translate", viser.Icon.ARROWS_EXCHANGE):
            self._tab = TranslateTab(
                self._client,
                self._shared.translators,
                self._notices,
                self._shared.frames,
                self._shared.background,
                lambda: self.look,
            )
        self._heed_files()
        pictures.dock_right()
        pictures.set_width(PICTURES_PX)
        pictures.expand()

    def _heed_files(self) -> None:
        """Takes what comes by the buttons, or is dropped on the page."""
        controls = self.controls
        takers: dict[str, tuple[viser.GuiUploadButtonHandle, Callable[[Path], object]]] = {
            "shape": (controls.upload_shape, partial(self._take_file, "shape", load_shape)),
            "layout": (
                controls.upload_layout,
                partial(self._take_file, "layout", self._fitting_layout),
            ),
            "calibration": (
                controls.upload_light,
                partial(self._take_file, "calibration", Calibration.load),
            ),
            "frame": (self._tab.upload, self._tab.show_file),
            "background": (self._tab.upload_background, self._tab.take_background),
        }
        for kind, (button, then) in takers.items():
            self._on_upload(button, kind, then)
        take_dropped(self._client, {kind: button for kind, (button, _) in takers.items()})

    def _add_take_away(self) -> None:
        gui = self._client.gui
        with gui.add_folder("Take it away", expand_by_default=False):
            take = gui.add_button(
                "This press as a zip file", icon=viser.Icon.DOWNLOAD, color=QUIET,
                hint="The folder that t2twin press writes: pictures, counts, contacts, scenes",
            )  # fmt: skip
            self._again = gui.add_html("")

        @take.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._one_at_a_time(self._take_away)

    def _one_at_a_time(self, do: Callable[[], object]) -> None:
        """Does something slow in a thread of its own, unless such is being done: what a client
        sends meanwhile must not pile up."""
        if not self._slow.acquire(blocking=False):
            self._notices.wrong(T2TwinError("the one before is still being worked on; wait for it"))
            return

        def work() -> None:
            try:
                self._notices.guarded(do)
            finally:
                self._slow.release()

        Thread(target=work, daemon=True).start()

    def _take_away(self) -> None:
        look = self.look
        if look is None or self._is_sending():
            return
        with TemporaryDirectory(dir=self.folder) as folder:
            name, content = zipped(look, Path(folder))
        self._client.send_file_download(name, content, save_immediately=True)

    def _is_sending(self) -> bool:
        """Whether a file is still on its way to the client."""
        unsent = self._client._websock_connection.get_message_buffer().message_from_id
        return any(isinstance(each, _messages.FileTransferPart) for each in list(unsent.values()))

    def _take_file(self, kind: str, read: Callable[[Path], object], path: Path) -> None:
        """Presses with a file, if it can be read; else the press stays what it is."""
        with self._notices.busy(f"Reading {path.name}", "This can take a while."):
            read(path)
        changes: dict[str, Any] = {kind: str(path)}
        self.controls.take(changes | ({"scale": None} if kind == "shape" else {}))
        forget(kind, self.folder, all_but=path)

    def _fitting_layout(self, path: Path) -> None:
        """Raises T2TwinError for a file that is no layout, or one that reaches beyond the cover."""
        layout, look = load_layout(path), self.look
        if look is not None:
            pad_weights(CYSKIN_COVER, look.touch.cyskin.x_mm, look.touch.cyskin.y_mm, layout)

    def _on_upload(
        self,
        button: viser.GuiUploadButtonHandle,
        kind: str,
        then: Callable[[Path], object],
    ) -> None:
        def take(file: viser.UploadedFile) -> None:
            path = kept_file(kind, file.name, file.content, self.folder)
            try:
                then(path)
            except T2TwinError as error:
                shutil.rmtree(path.parent, ignore_errors=True)
                raise T2TwinError(str(error).replace(str(path), path.name)) from None

        @button.on_upload
        async def _(event: viser.GuiEvent) -> None:
            file = button.value
            button._impl.value = viser.UploadedFile("", b"")  # or it would stay in memory
            self._one_at_a_time(lambda: take(file))

    def _drag(self, dragged: Dragged) -> None:
        if dragged.begins:
            self._dragged_from = self._state
            look = self.look  # knows the force that gives a depth
            self._force_from = self._state.force_n
            if look is not None and look.state == self._state:
                self._force_from = look.touch.command.force_n
        start, (along_x, along_y, along_z) = self._dragged_from, dragged.by_mm
        if dragged.keys is None:
            changes = {"x_mm": start.x_mm + along_x, "y_mm": start.y_mm + along_y}
        elif dragged.keys == "shift":
            changes = {"yaw_deg": start.yaw_deg + DEGREES_A_MM * along_x}
        else:
            force = self._force_from - NEWTONS_A_MM * along_z
            changes = {"force_n": min(max(force, MIN_SLIDER_N), MAX_SLIDER_N)}
        # Tenths, as the sliders have them: what is dragged by hand needs no more.
        self.controls.take({name: round(float(value), 1) for name, value in changes.items()})

    def _settle(self) -> None:
        self._notices.guarded(self._scene.settle)

    def _show_newest(self) -> None:
        self._notices.guarded(self._make_look)

    def _make_look(self) -> None:
        session = self._ready_session()
        state, runs = self._state, self._runs
        loaded = self._shared.translators.are_loaded(runs)
        look = session.look(state, runs if loaded else ())
        scales = scales_of(look)
        self._put_cards(look, scales, runs_come=not loaded)
        self.look = look
        most_kpa = {"digit": scales.digit_kpa, "cyskin": scales.cyskin_kpa}
        self._scene.draw(look, self._view.shown_as, most_kpa, scales.counts)
        self._shared.is_seen.set()
        if not loaded:
            self._load(runs)

    def _ready_session(self) -> Session:
        """This client's session, when the studio can press."""
        if self._session is None:
            if not self._shared.can_press.is_set():
                with self._notices.busy("Getting ready", FIRST_START):
                    self._shared.can_press.wait()
            self._session = Session(self._shared.translators, self._shared.sensors)
        return self._session

    def _load(self, runs: tuple[str, ...]) -> None:
        """In a thread of its own, so that the page follows its slider meanwhile."""
        if self._loading is not None and self._loading.is_alive():
            return  # it asks for a new look in the end, and that for these

        def load() -> None:
            if self._notices.guarded(lambda: self._shared.translators.load(runs)):
                self._worker.ask()

        self._loading = Thread(target=load, daemon=True)
        self._loading.start()

    def _put_cards(self, look: Look, scales: Scales, runs_come: bool) -> None:
        """Sends what stands beside the scene, on its own: a browser shows at once what is no part
        of the scene, and the rest when it has drawn the scene, which takes long without a GPU."""
        state, translators = look.state, self._shared.translators
        runs_come = runs_come or not translators.are_known
        pictures = pictures_html(look, scales, bool(translators.names), runs_come)
        files = [s for s in (state.shape, state.layout, state.calibration) if s and is_file(s)]
        with self._client.atomic():
            self._notices.well()
            self.controls.show_found(look)
            self._pictures.content = pictures
            self._again.content = again_html(
                state.command_line(), None if files else self._link(state)
            )
        self._client.flush()
        self._await_sent()

    def _await_sent(self) -> None:
        """Until viser's loop has sent what is flushed, so that it goes without what comes next."""
        sent = Event()

        def turn(left: int) -> None:
            if left:
                self._loop.call_soon(turn, left - 1)
            else:
                sent.set()

        with suppress(RuntimeError):  # the loop is closed, and the studio with it
            self._loop.call_soon_threadsafe(turn, TURNS)
            sent.wait(SENT_S)
