"""The page of one client: its controls, scene, cards and press."""

from collections.abc import Callable
from contextlib import suppress
from threading import Event, Lock
from typing import Any

import numpy as np
import viser

from t2twin.studio.cards import Scales, press_html, reproduce_html, scales_of, welcome_html
from t2twin.studio.controls import MAX_SLIDER_N, MIN_SLIDER_N, Controls, ViewOptions
from t2twin.studio.files import FileTasks
from t2twin.studio.press_state import PressState
from t2twin.studio.scene import Scene
from t2twin.studio.session import PressResult, Session
from t2twin.studio.shared import SharedState
from t2twin.studio.tasks import LatestOnlyWorker, Notices
from t2twin.studio.translate_tab import TranslateTab

DEGREES_PER_MM, NEWTONS_PER_MM = 4.0, 0.25
"""Rotation of a drag to the right with Shift, and force of a drag downwards with Ctrl (assumed)."""

FIRST_START = "The first start on a machine takes longer; later starts reuse its results."
"""Notice until the first press is complete."""

LOOP_ITERATIONS = 20
"""Iterations of viser's event loop after which flushed messages are sent: three times the required
number."""

SEND_TIMEOUT_S = 1.0
"""Maximum wait for these iterations, s; they take about a millisecond."""

CONTROLS_PX, CARDS_PX = 320, 420
"""Widths of the panels, px."""


class Page:
    """The page of one client.

    A change requests a press from the worker, which always uses the latest state. A slide takes
    several presses, so that the page shows its parts. controls: the panel. files: of the client.
    state: the requested press. result: the shown press, None before the first.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        shared: SharedState,
        state: PressState,
        link: Callable[[PressState], str],
    ) -> None:
        self._client, self._shared, self._link = client, shared, link
        self._lock = Lock()
        self.state, self._drag_start, self._drag_force_n = state, state, state.force_n
        self._runs: tuple[str, ...] = ()
        self._lifted = False
        self._session: Session | None = None
        self.result: PressResult | None = None
        self._notices = Notices(client)
        folder = shared.folder / str(client.client_id)
        self.files = FileTasks(client, self._notices, folder, lambda: self.result)
        self._loop = client.gui._event_loop
        self._scene = Scene(client, self._drag)
        self._build()
        self._worker = LatestOnlyWorker(
            lambda: self._notices.guard(self._press_and_show),
            lambda: self._notices.guard(self._scene.hide_old_surfaces),
        )
        # Loads in a thread of its own, so that the page still follows its sliders.
        self._loader = LatestOnlyWorker(lambda: self._notices.guard(self._load))
        self.update_runs()
        self._worker.request()

    def close(self) -> None:
        """Stops the page of a disconnected client and removes its files."""
        self._worker.stop()
        self._loader.stop()
        self._tab.close()
        self.files.remove()

    def join(self, timeout_s: float) -> None:
        """Waits for the press that began before `close`."""
        self._worker.join(timeout_s)

    def wait(self, timeout_s: float) -> bool:
        """Waits until the page shows its latest state, including files and translators.

        timeout_s: of each. Returns False after a timeout.
        """
        works = (self.files, self._worker, self._loader, self._worker)
        return all(each.wait(timeout_s) for each in works)

    def change(self, changes: dict[str, Any]) -> PressState:
        """Changes fields of the state and requests its press."""
        with self._lock:
            before, self.state = self.state, self.state.with_changes(changes)
            self._lifted |= not self.state.continues(before)
            state = self.state
        self._worker.request()
        return state

    def lift_off(self) -> None:
        """Ends the slide and presses again."""
        with self._lock:
            self._lifted = True
        self._worker.request()

    def update_runs(self) -> None:
        """Adds a checkbox for each new run."""
        names, default = self._shared.translators.names, self._shared.translators.default_names
        with self._lock:
            new = [name for name in names if name not in self._run_boxes]
            with self._runs_folder:
                for name in new:
                    box = self._client.gui.add_checkbox(name, name in default)
                    box.on_update(self._runs_changed)
                    self._run_boxes[name] = box
            self._runs_folder.visible = bool(names)
        if new:
            self._use_runs(default)
        else:
            self._worker.request()  # the page also states that there are no runs

    async def _runs_changed(self, event: viser.GuiEvent) -> None:
        runs = tuple(name for name, box in self._run_boxes.items() if box.value)
        self._notices.guard(lambda: self._use_runs(runs))

    def _use_runs(self, runs: tuple[str, ...]) -> None:
        self._runs = runs
        self._tab.use_runs(runs)
        self._worker.request()

    def _build(self) -> None:
        gui = self._client.gui
        gui.set_panel_label("t2twin studio")
        gui.main_panel.dock_left()
        gui.main_panel.set_width(CONTROLS_PX)
        gui.add_html(welcome_html())
        self.controls = Controls(
            self._client, self.state, self.change, self.lift_off, self._notices
        )
        self._view = ViewOptions(
            self._client, self._notices, self._scene.arrange, lambda: self._worker.request()
        )
        self._runs_folder = gui.add_folder("Translators", expand_by_default=False, visible=False)
        self._run_boxes: dict[str, viser.GuiCheckboxHandle] = {}
        with gui.add_folder("Export", expand_by_default=False):
            self.files.add_export_button()
            self._reproduce = gui.add_html("")
        cards = gui.add_panel()
        with cards.add_tab("Images", viser.Icon.PHOTO):
            self._cards = gui.add_html("")
        with cards.add_tab("Translate", viser.Icon.ARROWS_EXCHANGE):
            self._tab = TranslateTab(self._client, self._shared, self._notices, lambda: self.result)
        self.files.connect(self.controls, self._tab)
        cards.dock_right()
        cards.set_width(CARDS_PX)
        cards.expand()
        self._scene.arrange("both", CONTROLS_PX + CARDS_PX)

    def _drag(self, by_mm: np.ndarray, key: str | None, is_start: bool) -> None:
        if is_start:
            self._drag_start = self.state
            self._drag_force_n = self.state.force_n
            result = self.result  # contains the force of a given depth
            if result is not None and result.state == self.state:
                self._drag_force_n = result.touch.command.force_n
        start, (along_x, along_y, along_z) = self._drag_start, by_mm
        if key is None:
            changes = {"x_mm": start.x_mm + along_x, "y_mm": start.y_mm + along_y}
        elif key == "shift":
            changes = {"yaw_deg": start.yaw_deg + DEGREES_PER_MM * along_x}
        else:
            force = self._drag_force_n - NEWTONS_PER_MM * along_z
            changes = {"force_n": min(max(force, MIN_SLIDER_N), MAX_SLIDER_N)}
        # Rounded to tenths, the resolution of the sliders.
        self.controls.apply({name: round(float(value), 1) for name, value in changes.items()})

    def _press_and_show(self) -> None:
        session = self._get_session()
        with self._lock:
            state, lifted, self._lifted = self.state, self._lifted, False
        error = self._notices.shown
        if lifted:
            session.lift_off()
        runs = self._runs
        loaded = self._shared.translators.are_loaded(runs)
        result = session.press(state, runs if loaded else ())
        scales = scales_of(result)
        self._send_cards(result, scales, not loaded, error)
        self.result = result
        view = self._view
        arrows = view.arrows.value
        self._scene.draw(result, view.shape_style.value, scales.kpa, scales.counts, arrows)
        if result.is_behind:
            self._worker.request()
        self._shared.page_shown.set()
        if not loaded:
            self._loader.request()

    def _get_session(self) -> Session:
        """The client's session; waits for the first press of the studio."""
        if self._session is None:
            if not self._shared.press_ready.is_set():
                with self._notices.progress("Getting ready", FIRST_START):
                    self._shared.press_ready.wait()
            self._session = Session(self._shared.translators, self._shared.sensors)
        return self._session

    def _load(self) -> None:
        self._shared.translators.load(self._runs)
        self._worker.request()

    def _send_cards(
        self,
        result: PressResult,
        scales: Scales,
        loading: bool,
        error: viser.NotificationHandle | None,
    ) -> None:
        """Sends the cards before the scene: a browser applies all changes of one message together,
        and rendering the scene takes long without a GPU. error: one that this press ends."""
        state, translators = result.state, self._shared.translators
        loading = loading or not translators.is_searched
        cards = press_html(result, scales, bool(translators.names), loading)
        with self._client.atomic():
            self._notices.clear(error)
            self.controls.show_solved_values(result)
            self._cards.content = cards
            link = None if state.files or result.has_slid else self._link(state)
            self._reproduce.content = reproduce_html(result.command_line(), link)
        self._client.flush()
        self._wait_until_sent()

    def _wait_until_sent(self) -> None:
        """Waits until viser's event loop has sent the flushed messages."""
        sent = Event()

        def iterate(left: int) -> None:
            if left:
                self._loop.call_soon(iterate, left - 1)
            else:
                sent.set()

        with suppress(RuntimeError):  # the loop is closed with the studio
            self._loop.call_soon_threadsafe(iterate, LOOP_ITERATIONS)
            sent.wait(SEND_TIMEOUT_S)
