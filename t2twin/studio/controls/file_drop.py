"""Files dropped anywhere on the page are passed to the upload button of their kind.

viser's buttons accept no dropped files, and a browser opens a file that is dropped elsewhere.
"""

import json
from collections.abc import Mapping

import viser
from viser import _messages

from t2twin.studio.transport.uploads import suffixes_of

SCRIPT = """
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
"""Script of the page. The class t2-drop marks it while a file is held over it. The shape button
receives files of an unknown kind and reports the error. viser removes buttons of a closed panel."""


def accept_dropped_files(
    client: viser.ClientHandle, buttons: Mapping[str, viser.GuiUploadButtonHandle]
) -> None:
    """Uploads dropped files as if their button had been used. buttons: by kind of file.

    viser sends scripts to pages only for its own charts, so this uses its internal message.
    """
    known = {
        kind: {"id": button._impl.uuid, "suffixes": suffixes_of(kind)}
        for kind, button in buttons.items()
    }
    script = SCRIPT.replace("BUTTONS", json.dumps(known))
    client.gui._websock_interface.queue_message(_messages.RunJavascriptMessage(source=script))
