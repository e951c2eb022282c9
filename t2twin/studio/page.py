"""The page of one client: its controls, scene, cards and press, and its tab of own images."""

import io
import shutil
import tempfile
import zipfile
from pathlib import Path
from threading import Event, Lock, Thread
from typing import get_args

import numpy as np
import viser

from t2twin.core.errors import T2TwinError
from t2twin.studio import cards
from t2twin.studio.controls import MAX_SLIDER_N, MIN_SLIDER_N, Controls, Inputs
from t2twin.studio.scene import Scene, Sensors, ShapeStyle
from t2twin.studio.session import PressResult, PressState, Session, file_name
from t2twin.studio.translators import NamedFrame, Shared

DEGREES_PER_MM, NEWTONS_PER_MM = 4.0, 0.25
"""Rotation of a drag to the right with Shift, and force of a drag downwards with Ctrl (assumed)."""

WELCOME = (
    "Press a shape into two touch sensors. Move a slider or drag the shape: Shift rotates it, "
    "Ctrl changes the force."
)
FIRST_START = "The first start on a machine takes longer; later starts reuse its results."

SETTLED_S = 0.1
"""Time without a new press after which the previous surfaces are hidden (assumed)."""

CONTROLS_PX, CARDS_PX = 320, 420  # widths of the panels

ACCENT, DARK_ACCENT = (11, 83, 148), (138, 184, 240)  # RGB by theme, as links in the reports

MAX_SHOWN_HZ = 15.0
"""Maximum rate at which a page receives frames of a live source (assumed)."""

NO_BACKGROUND = "none; field runs use the mean of their training"


class Page:
    """The page of one client.

    A change requests a press from a thread of the page, which always uses the latest state. A slide
    takes several presses, so that the page shows its parts. After the first press another thread
    loads the translators. controls: the panel. tab: of own images. folder: of the client's files.
    runs: names of the selected translators. result: the shown press, None before the first.
    """

    def __init__(self, client: viser.ClientHandle, shared: Shared) -> None:
        self._client, self.shared = client, shared
        self.folder = Path(tempfile.mkdtemp(dir=shared.folder))
        self.inputs = Inputs(client, self.folder)
        self.runs: tuple[str, ...] = ()
        self._missing = cards.LOADING  # in place of translations
        self.result: PressResult | None = None
        self._requested, self._idle = Event(), Event()
        self._session = Session()
        self._scene = Scene(client, self._drag, CONTROLS_PX + CARDS_PX)
        self._build()
        Thread(target=self._work, daemon=True).start()

    @property
    def state(self) -> PressState:
        """The requested press."""
        return self.controls.state

    @property
    def is_idle(self) -> bool:
        """Whether the page shows the requested press, or why it is not possible."""
        return self._idle.is_set() and not self._requested.is_set()

    def close(self) -> None:
        """Stops the page of a disconnected client and removes its files."""
        self.inputs.is_closed = True
        for event in (self._requested, self._idle):
            event.set()
        self.tab.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def request(self) -> None:
        """Requests a press of the latest state."""
        self._requested.set()

    def _build(self) -> None:
        """Creates both panels."""
        inputs, gui = self.inputs, self.inputs.gui
        gui.set_panel_label("t2twin studio")
        gui.main_panel.dock_left()
        gui.main_panel.set_width(CONTROLS_PX)
        gui.add_html(cards.card_html(style=True, texts=[WELCOME]))
        self.controls = Controls(inputs, self.request, self._lift_off)
        with gui.add_folder("View", expand_by_default=False):
            sensors = gui.add_dropdown("Sensors", get_args(Sensors))
            self._style = gui.add_dropdown("Shape as", get_args(ShapeStyle))
            self._with_arrows = gui.add_checkbox(
                "Traction arrows", True, hint="Of a slide: stick blue, slip orange"
            )
            dark = gui.add_checkbox("Dark", False)
        inputs.connect(sensors.on_update, self._scene.arrange)
        for handle in (self._style, self._with_arrows):
            inputs.connect(handle.on_update, lambda _: self.request())
        inputs.connect(dark.on_update, self._set_theme)
        self._set_theme(False)
        self._run_boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self._runs_folder = gui.add_folder("Translators", expand_by_default=False, visible=False)
        with gui.add_folder("Export", expand_by_default=False):
            icon = viser.Icon.DOWNLOAD
            inputs.button("Download this press (zip)", icon, self._download, slow=True)
            self._command = gui.add_html("")
        panel = gui.add_panel()
        with panel.add_tab("Images", viser.Icon.PHOTO):
            self._cards = gui.add_html("")
        with panel.add_tab("Translate", viser.Icon.ARROWS_EXCHANGE):
            self.tab = TranslateTab(self)
        panel.dock_right()
        panel.set_width(CARDS_PX)
        panel.expand()

    def _set_theme(self, dark: bool) -> None:
        self.inputs.gui.configure_theme(
            dark_mode=dark,
            brand_color=DARK_ACCENT if dark else ACCENT,
            control_width="large",
            show_logo=False,
            show_share_button=False,
        )

    def _lift_off(self) -> None:
        """Ends the slide and presses again."""
        self._session.lift_off()
        self.request()

    def _drag(self, by_mm: np.ndarray, key: str | None, is_start: bool) -> None:
        """Changes the pose or the force by a drag of the shape."""
        if is_start:
            self._drag_start = self.state
            self._drag_force_n = self.controls.handles["force_n"].value
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

    def _work(self) -> None:
        """Presses until the page is closed."""
        self.inputs.notify("Getting ready", FIRST_START, loading=True)
        Thread(target=self.inputs.guard, args=(self._find_runs,), daemon=True).start()
        while self._requested.wait() and not self.inputs.is_closed:
            self._idle.clear()
            self._requested.clear()
            self.inputs.guard(self._press_and_show)
            if not self._requested.wait(SETTLED_S):
                self._scene.hide_old_surfaces()
                self._idle.set()

    def _find_runs(self) -> None:
        """Adds a checkbox for each run and loads the default ones, after the first press."""
        self._idle.wait()
        self._translators = self._session.translators = self.shared.translators()
        with self._runs_folder:
            for name in self._translators.names:
                is_default = name in self._translators.default_names
                box = self._run_boxes[name] = self.inputs.gui.add_checkbox(name, is_default)
                self.inputs.connect(box.on_update, lambda _: self._use_runs(), slow=True)
        self._runs_folder.visible = bool(self._run_boxes)
        self._use_runs()

    def _use_runs(self) -> None:
        """Loads the selected runs and translates with them."""
        selected = [name for name, box in self._run_boxes.items() if box.value]
        for name in selected:
            self._translators.load(name)
        self.runs = tuple(selected)
        self._missing = "" if self._translators.names else cards.NO_RUNS
        self.request()
        self.tab.translate()

    def _press_and_show(self) -> None:
        """Presses the latest state and shows the cards, then the scene.

        A browser applies all changes of one message together, and drawing takes long without a GPU.
        """
        result = self._session.press(self.state, self.runs)
        kpa, counts = cards.scales_of(result)
        html = cards.press_html(result, kpa, counts, self._missing)
        if self.inputs.is_closed:
            return
        with self._client.atomic():
            self.inputs.notify()
            self.controls.show_solved_values(result)
            self._cards.content = html
            self._command.content = cards.card_html(command=result.command_line())
        self._client.flush()
        self.result = result
        self._scene.draw(result.touch, self._style.value, kpa, counts, self._with_arrows.value)
        if any(result.remaining):
            self.request()

    def _download(self) -> None:
        """Sends a zip archive of the folder that `t2twin press` writes."""
        result = self.result
        if result is None:
            return
        name, content = file_name(result.touch.shape.name).replace("/", "-"), io.BytesIO()
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            result.save(Path(folder))
            with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
                for path in sorted(Path(folder).iterdir()):
                    archive.write(path, f"{name}/{path.name}")
        self._client.send_file_download(f"{name}.zip", content.getvalue(), save_immediately=True)


class TranslateTab:
    """The tab of a page that translates frames of the user with all selected runs.

    It is created inside its container.
    """

    def __init__(self, page: Page) -> None:
        inputs, gui, shared = page.inputs, page.inputs.gui, page.shared
        self._page = page
        self._frame: NamedFrame | None = None
        self._ended, self._lock = Event(), Lock()
        gui.add_markdown(
            "Predicts counts from an upright frame of the gel camera that a run was trained on."
        )
        self.upload = inputs.upload(
            "Upload a frame",
            "PNG or JPEG of any size",
            lambda path: self._show(shared.read_frame(path)),
        )
        icons = viser.Icon
        inputs.button("Current image, with noise", icons.PHOTO, self._show_current, slow=True)
        self._background_name = gui.add_html("")
        inputs.upload(
            "Upload a background frame",
            "Frame of the same sensor without contact",
            lambda path: self._set_background(shared.read_frame(path)),
        )
        self._no_background = inputs.button(
            "Remove the background frame", icons.X, lambda: self._set_background(None), slow=True
        )
        files = shared.source_files()
        if len(files) > 1:
            slider = gui.add_slider(
                "Frame", 0, len(files) - 1, 1, 0, hint="Number of the file, sorted by name"
            )
            show_file = lambda number: self._show(shared.read_frame(files[number]))  # noqa: E731
            inputs.connect(slider.on_update, show_file, slow=True)
        if shared.source is not None:
            live = gui.add_checkbox(
                f"Live: {Path(shared.source).name}", False, hint="Translate frames as they arrive"
            )
            inputs.connect(live.on_update, self._follow, slow=True)
        self._shown = gui.add_html("")
        self._set_background(shared.background)

    def close(self) -> None:
        """Stops following the source."""
        self._ended.set()

    def _set_background(self, frame: NamedFrame | None) -> None:
        self._background = frame
        self._no_background.visible = frame is not None
        text = f"Background frame: {NO_BACKGROUND if frame is None else frame[1]}"
        self._background_name.content = cards.card_html(texts=[text])
        self.translate()

    def _follow(self, is_on: bool) -> None:
        """Translates the frames of the studio's source until the box is cleared."""
        self._ended.set()
        if not is_on:
            return
        self._ended = ended = Event()
        latest, last = self._page.shared.latest_frames(), -1
        while not ended.is_set():
            frame = latest.take(last, timeout_s=1.0)
            if frame is None and latest.ended:
                return
            if frame is not None:
                last = frame.number
                self._show((frame.image, f"frame {frame.number}"))
                ended.wait(1.0 / MAX_SHOWN_HZ)

    def _show_current(self) -> None:
        """Translates the image of the press with other noise."""
        result = self._page.result
        if result is not None:
            reading = result.touch.of_camera
            if reading is None:
                raise T2TwinError("neither sensor is a gel camera, so there is no image")
            noisy = reading.sensor.image(reading.contact, np.random.default_rng())
            self._show((noisy, f"{result.touch.shape.name}, one frame with noise"))

    def _show(self, frame: NamedFrame) -> None:
        self._frame = frame
        self.translate()

    def translate(self) -> None:
        """Translates the latest frame, if there is one."""
        with self._lock:
            frame, background, runs = self._frame, self._background, self._page.runs
            if frame is not None:
                pixels = None if background is None else background[0]
                translators = self._page.shared.translators()
                found = translators.translate(frame[0], runs, pixels)
                self._shown.content = cards.frame_html(frame, background, found)
