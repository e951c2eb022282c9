"""Files of one client: uploads, and the download of a press."""

import io
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from typing import Any

import viser
from viser import _messages

from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.layout import load_layout
from t2twin.sim.cyskin.taxels import pad_pressure_mpa
from t2twin.sim.digit.calibration import Calibration
from t2twin.studio.controls.file_drop import accept_dropped_files
from t2twin.studio.controls.inputs import Inputs
from t2twin.studio.controls.press import Controls
from t2twin.studio.controls.translate_tab import TranslateTab
from t2twin.studio.press_state import file_name
from t2twin.studio.session import PressResult
from t2twin.studio.slide import PATH_FILE
from t2twin.studio.transport.uploads import remove_uploads, save_upload
from t2twin.studio.view.notices import Notices
from t2twin.twin import load_shape

COMMAND_FILE = "command.txt"
"""File of the zip archive with the command line of the press."""


class FileTasks:
    """Runs the file tasks of one client, one at a time, each in a thread of its own.

    folder: files of the client; created with the first file. get_result: returns the shown press.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        notices: Notices,
        folder: Path,
        get_result: Callable[[], PressResult | None],
    ) -> None:
        self._client, self._notices = client, notices
        self._folder, self._get_result = folder, get_result
        self._running = Lock()

    @property
    def folder(self) -> Path:
        """Folder of the client's files."""
        self._folder.mkdir(exist_ok=True)
        return self._folder

    def remove(self) -> None:
        """Removes the client's files."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def wait(self, timeout_s: float) -> bool:
        """Waits for the running task; False after the timeout."""
        done = self._running.acquire(timeout=timeout_s)
        if done:
            self._running.release()
        return done

    def add_export_button(self) -> None:
        """Adds the button that downloads the shown press."""
        Inputs(self._client.gui, self._notices).button(
            "Download this press (zip)", viser.Icon.DOWNLOAD, lambda: self._run(self._export),
            hint="The folder that t2twin press writes: images, counts, contacts, scenes",
        )  # fmt: skip

    def connect(self, controls: Controls, tab: TranslateTab) -> None:
        """Handles files from the upload buttons and files dropped on the page."""
        use = partial(partial, self._use, controls)
        handlers: dict[str, tuple[viser.GuiUploadButtonHandle, Callable[[Path], object]]] = {
            "shape": (controls.upload_shape, use("shape", load_shape)),
            "layout": (controls.upload_layout, use("layout", self._check_layout)),
            "calibration": (controls.upload_calibration, use("calibration", Calibration.load)),
            "frame": (tab.upload, tab.show_file),
            "background": (tab.upload_background, tab.use_background),
        }
        for kind, (button, handle) in handlers.items():
            self._on_upload(button, kind, handle)
        accept_dropped_files(self._client, {kind: button for kind, (button, _) in handlers.items()})

    def _on_upload(
        self, button: viser.GuiUploadButtonHandle, kind: str, handle: Callable[[Path], object]
    ) -> None:
        def store(file: viser.UploadedFile) -> None:
            path = save_upload(kind, file.name, file.content, self.folder)
            try:
                handle(path)
            except T2TwinError as error:
                shutil.rmtree(path.parent, ignore_errors=True)
                raise T2TwinError(str(error).replace(str(path), path.name)) from None

        @button.on_upload
        async def _(event: viser.GuiEvent) -> None:
            file = button.value
            button._impl.value = viser.UploadedFile("", b"")  # releases the memory
            self._run(lambda: store(file))

    def _run(self, task: Callable[[], object]) -> None:
        """Runs a slow task, unless one is running: a client's requests must not accumulate."""
        if not self._running.acquire(blocking=False):
            self._notices.show_error(T2TwinError("another file is being processed; try again"))
            return

        def run() -> None:
            try:
                self._notices.guard(task)
            finally:
                self._running.release()

        Thread(target=run, daemon=True).start()

    def _use(
        self, controls: Controls, kind: str, read: Callable[[Path], object], path: Path
    ) -> None:
        """Presses with a file if it is readable; otherwise the press remains as it is."""
        with self._notices.progress(f"Reading {path.name}", "This can take a while."):
            read(path)
        changes: dict[str, Any] = {kind: str(path)}
        controls.apply(changes | ({"scale": None} if kind == "shape" else {}))
        remove_uploads(kind, self.folder, all_but=path)

    def _check_layout(self, path: Path) -> None:
        """Raises T2TwinError for an invalid layout and for one that exceeds the cover."""
        layout, result = load_layout(path), self._get_result()
        if result is not None:
            pad_pressure_mpa(result.touch.cyskin, layout)

    def _export(self) -> None:
        result = self._get_result()
        if result is None or self._is_sending():
            return
        with TemporaryDirectory(dir=self.folder) as folder:
            name, content = zip_press(result, Path(folder))
        self._client.send_file_download(name, content, save_immediately=True)

    def _is_sending(self) -> bool:
        """Whether a download to the client is unfinished."""
        unsent = self._client._websock_connection.get_message_buffer().message_from_id
        return any(isinstance(each, _messages.FileTransferPart) for each in list(unsent.values()))


def zip_press(result: PressResult, folder: Path) -> tuple[str, bytes]:
    """Name and content of a zip archive of the folder that `t2twin press` writes.

    For a slide it contains the last touch, and the path that the command line needs. folder:
    temporary folder to write into. Raises T2TwinError if it cannot be written, and for a layout
    without a tactile image.
    """
    name = result.touch.shape.name.replace("/", "-")
    calibration = result.state.calibration
    touch = replace(
        result.touch, calibration=None if calibration is None else file_name(calibration)
    )
    place = folder / "press"
    touch.save(place)
    (place / COMMAND_FILE).write_text(result.command_line() + "\n")
    if result.slide is not None and result.has_slid:
        (place / PATH_FILE).write_text(result.slide.path_csv())
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(place.iterdir()):
            archive.write(path, f"{name}/{path.name}")
    return f"{name}.zip", buffer.getvalue()
