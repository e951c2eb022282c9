"""Files of one client: uploads with their limits, dropped files, and the download of a press."""

import json
import re
import shutil
import tempfile
import tomllib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from threading import Lock, Thread
from typing import Any

import viser
from viser import _messages

from t2twin.core import images
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.mesh_files import SUFFIXES
from t2twin.sim.optical.optics import Optics
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.layout import load_layout
from t2twin.sim.taxels.pads import check_on_cover
from t2twin.studio.access import MAX_MESSAGE
from t2twin.studio.controls import Controls, Inputs
from t2twin.studio.press_state import file_name
from t2twin.studio.session import PATH_FILE, PressResult
from t2twin.studio.tasks import Notices
from t2twin.studio.translate_tab import TranslateTab
from t2twin.twin import load_shape

MAX_BYTES = 64_000_000
"""Maximum size of a file, and of all unfinished uploads of a client, bytes (assumed: about 1
million triangles)."""

PART_BYTES = MAX_MESSAGE // 2
"""Size of all parts of an upload but the last, bytes (viser)."""

MAX_NAME = 40
"""Maximum length of the stem of a stored file name, and of a quoted name, characters."""

SUFFIXES = {
    "shape": SUFFIXES,
    "layout": (".json", ".csv"),
    "optics": (".npz",),
    "sensor": (".toml",),
    "frame": images.SUFFIXES,
    "background": images.SUFFIXES,
}
"""Allowed suffixes by kind of file."""

COMMAND_FILE = "command.txt"
"""File of the zip archive with the command line of the press."""

DROP_SCRIPT = """
window.t2twinDrop?.abort();  // listeners of the previous connection, whose buttons are gone
window.t2twinDrop = new AbortController();
const buttons = BUTTONS, options = {signal: window.t2twinDrop.signal};
const show = (held) => document.documentElement.classList.toggle("t2-drop", held);
const listen = (name, handle) => window.addEventListener(name, (event) => {
  if (!event.dataTransfer?.types.includes("Files")) return;
  event.preventDefault();
  handle(event);
}, options);
listen("dragover", () => show(true));
listen("dragleave", (event) => { if (event.relatedTarget === null) show(false); });
listen("drop", (event) => {
  show(false);
  const files = event.dataTransfer.files, name = files[0]?.name.toLowerCase() ?? "";
  const find = (kind) => document.getElementById(`file_upload_${buttons[kind]?.id}`);
  const accepts = (kind) => buttons[kind].suffixes.some((suffix) => name.endsWith(suffix));
  const kind = Object.keys(buttons).find(accepts);
  const button = find(kind) ?? find("shape");
  if (!files.length) return;
  if (button === null) return alert("The panel of controls is closed; open it to drop a file.");
  button.files = files;
  button.dispatchEvent(new Event("change", {bubbles: true}));
});
"""
"""Script of the page, because viser's buttons accept no dropped files. The class t2-drop marks it
while a file is held over it. The shape button receives files of an unknown kind and reports the
error. viser removes buttons of a closed panel."""


class FileTasks:
    """Runs the file tasks of one client, one at a time, each in a thread of its own.

    folder: of the client's files, created here. get_result: returns the shown press.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        notices: Notices,
        folder: Path,
        get_result: Callable[[], PressResult | None],
    ) -> None:
        self._client, self._notices = client, notices
        self.folder, self._get_result = folder, get_result
        folder.mkdir()
        self._running = Lock()
        limit_uploads(client, notices)

    def remove(self) -> None:
        """Removes the client's files."""
        shutil.rmtree(self.folder, ignore_errors=True)

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
        readers = {
            "shape": load_shape,
            "layout": self._check_layout,
            "optics": Optics.load,
            "sensor": check_sensor,
        }

        def press_with(kind: str, path: Path) -> None:
            """Presses with a file if it is readable; otherwise the press remains as it is."""
            with self._notices.progress(f"Reading {path.name}", "This can take a while."):
                readers[kind](path)
            if kind == "sensor":
                controls.use_sensor(path)
            else:
                controls.apply({kind: str(path)} | ({"scale": None} if kind == "shape" else {}))
            remove_uploads(kind, self.folder, all_but=[Path(each) for each in controls.state.files])

        handlers = dict.fromkeys(readers, press_with)
        handlers["frame"] = lambda kind, path: tab.show_file(path)
        handlers["background"] = lambda kind, path: tab.use_background(path)
        buttons = controls.uploads | tab.uploads
        for kind, button in buttons.items():
            self._on_upload(button, kind, handlers[kind])
        accept_dropped_files(self._client, buttons)

    def _on_upload(
        self, button: viser.GuiUploadButtonHandle, kind: str, handle: Callable[[str, Path], object]
    ) -> None:
        def store(file: viser.UploadedFile) -> None:
            path = save_upload(kind, file.name, file.content, self.folder)
            try:
                handle(kind, path)
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

    def _check_layout(self, path: Path) -> None:
        """Raises T2TwinError for an invalid layout and for one that exceeds the cover."""
        layout, result = load_layout(path), self._get_result()
        if result is not None and result.touch.of_array is not None:
            check_on_cover(layout, result.touch.of_array.sensor.elastomer)

    def _export(self) -> None:
        result = self._get_result()
        if result is None:
            return
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            name, content = zip_press(result, Path(folder))
        self._client.send_file_download(name, content, save_immediately=True)


def limit_uploads(client: viser.ClientHandle, notices: Notices) -> None:
    """Refuses files of a client above MAX_BYTES before they are received, with a notice.

    viser keeps uploads of any number and size in memory, and accepts parts of at most MAX_MESSAGE.
    """
    gui, connection = client.gui, client.gui._websock_interface
    unfinished = gui._current_file_upload_states

    def start(number: Any, message: _messages.FileTransferStartUpload) -> None:
        size = message.size_bytes
        try:
            check_size(message.filename, size)
            if message.part_count * PART_BYTES >= size + PART_BYTES:
                raise T2TwinError("a file is larger than announced; upload it again")
            if sum(each["total_bytes"] for each in unfinished.values()) + size > MAX_BYTES:
                raise T2TwinError("other files are being uploaded; try again when they are done")
        except T2TwinError as error:
            notices.show_error(error)
            # Acknowledged as complete, because the page would wait otherwise.
            connection.queue_message(
                _messages.FileTransferPartAck(
                    message.source_component_uuid, message.transfer_uuid, size, size
                )
            )
            return
        gui._handle_file_transfer_start(number, message)

    connection.unregister_handler(_messages.FileTransferStartUpload)
    connection.register_handler(_messages.FileTransferStartUpload, start)


def check_size(name: str, size: int) -> None:
    """Raises T2TwinError for a file that is too large."""
    if not 0 <= size <= MAX_BYTES:
        raise T2TwinError(
            f"{name[:MAX_NAME]!r} has {size / 1e6:,.0f} MB; at most {MAX_BYTES / 1e6:,.0f} MB are "
            "allowed"
        )


def save_upload(kind: str, name: str, content: bytes, folder: Path) -> Path:
    """Stores an uploaded file in a new subfolder of `folder` and returns its path.

    The name keeps its letters, digits, dots, dashes and underscores. Raises T2TwinError for a
    suffix that the kind does not allow and for a file that is too large.
    """
    plain = Path(name.replace("\\", "/"))
    suffix = plain.suffix.lower()
    if suffix not in SUFFIXES[kind]:
        raise T2TwinError(
            f"{name[:MAX_NAME]!r} cannot be used as a {kind}; expected a file of "
            f"{', '.join(SUFFIXES[kind])}"
        )
    check_size(name, len(content))
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", plain.stem).strip("._-")[:MAX_NAME] or kind
    path = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=folder)) / f"{stem}{suffix}"
    path.write_bytes(content)
    return path


def check_sensor(path: Path) -> None:
    """Raises T2TwinError for an invalid sensor file, and for one that names files of this machine:
    a client must not read them."""
    try:
        content = tomllib.loads(path.read_text("utf-8-sig"))
    except (ValueError, RecursionError):
        content = {}  # load_sensor names the fault
    for table, key in ((None, "extends"), ("light", "optics"), ("layout", "file")):
        place = content if table is None else content.get(table)
        name = str(place.get(key, "") if isinstance(place, dict) else "")
        if name and (Path(name).name != name or Path(name).suffix):
            raise T2TwinError(
                f"{path} names the file {name[:MAX_NAME]!r}, which a page cannot use; expected "
                "names of bundled sensors and layouts"
            )
    load_sensor(path)


def remove_uploads(kind: str, folder: Path, all_but: Collection[Path]) -> None:
    """Removes the stored files of a kind, except some."""
    kept = {path.parent for path in all_but}
    for place in folder.glob(f"{kind}-*"):
        if place not in kept:
            shutil.rmtree(place, ignore_errors=True)


def accept_dropped_files(
    client: viser.ClientHandle, buttons: Mapping[str, viser.GuiUploadButtonHandle]
) -> None:
    """Uploads files dropped on the page as if their button had been used.

    buttons: by kind of file. viser sends scripts to pages only for its own charts, so this uses its
    internal message.
    """
    known = {
        kind: {"id": button._impl.uuid, "suffixes": SUFFIXES[kind]}
        for kind, button in buttons.items()
    }
    script = DROP_SCRIPT.replace("BUTTONS", json.dumps(known))
    client.gui._websock_interface.queue_message(_messages.RunJavascriptMessage(source=script))


def zip_press(result: PressResult, folder: Path) -> tuple[str, bytes]:
    """Name and content of a zip archive of the folder that `t2twin press` writes.

    For a slide it contains the last touch, and the path that the command line needs. folder:
    temporary folder to write into. Raises T2TwinError if it cannot be written, and for a layout
    without a tactile image.
    """
    name = result.touch.shape.name.replace("/", "-")
    optics, place = result.state.optics, folder / name
    result.touch.save(place)
    if optics is not None:  # without its place on this machine
        press = place / "press.json"
        press.write_text(
            press.read_text().replace(json.dumps(optics), json.dumps(file_name(optics)))
        )
    (place / COMMAND_FILE).write_text(result.command_line() + "\n")
    if result.slide is not None and result.has_slid:
        (place / PATH_FILE).write_text(result.slide.path_csv())
    archive = Path(shutil.make_archive(str(place), "zip", folder, name))
    return archive.name, archive.read_bytes()
