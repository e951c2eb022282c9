"""A file that is dropped anywhere on the page goes to the button that takes its kind.

viser's buttons are no places to drop a file on, and a browser leaves the page for one that is
dropped beside them.
"""

import json
from collections.abc import Mapping

import viser
from viser import _messages

from t2twin.studio.transport.uploads import KINDS

DROPPED = "t2-drop"
"""Class of the page while a file is held over it."""

CLOSED = "The panel of controls is closed; open it to drop a file."
"""What is said where there is no button, as viser's closed panels have none."""

SCRIPT = """
window.t2twinDrop?.abort();  // of the connection before this one, whose buttons are gone
window.t2twinDrop = new AbortController();
const buttons = BUTTONS, heed = {signal: window.t2twinDrop.signal};
const show = (held) => document.documentElement.classList.toggle("DROPPED", held);
const listen = (name, then) => window.addEventListener(name, (event) => {
  if (!event.dataTransfer?.types.includes("Files")) return;
  event.preventDefault();
  then(event);
}, heed);
listen("dragover", () => show(true));
listen("dragleave", (event) => { if (event.relatedTarget === null) show(false); });
listen("drop", (event) => {
  show(false);
  const files = event.dataTransfer.files, name = files[0]?.name.toLowerCase() ?? "";
  const there = (kind) => document.getElementById(`file_upload_${buttons[kind]?.id}`);
  const takes = (kind) => buttons[kind].ends.some((end) => name.endsWith(end));
  const kind = Object.keys(buttons).find(takes);
  const button = there(kind) ?? there("shape");
  if (!files.length) return;
  if (button === null) return alert("CLOSED");
  button.files = files;
  button.dispatchEvent(new Event("change", {bubbles: true}));
});
"""
"""What the page does with it. What no button takes goes to the shape's, which says what it does."""


def take_dropped(
    client: viser.ClientHandle, buttons: Mapping[str, viser.GuiUploadButtonHandle]
) -> None:
    """From here on a dropped file is sent as if its button had been pressed.

    buttons: by the kinds of t2twin.studio.transport.uploads.KINDS. viser sends pages a script for
    its own charts alone, so this reaches into it.
    """
    known = {
        kind: {"id": button._impl.uuid, "ends": KINDS[kind]} for kind, button in buttons.items()
    }
    script = SCRIPT.replace("BUTTONS", json.dumps(known)).replace("CLOSED", CLOSED)
    script = script.replace("DROPPED", DROPPED)
    run_script(client, script)


def run_script(client: viser.ClientHandle, script: str) -> None:
    """Runs a script in a client's page."""
    message = _messages.RunJavascriptMessage(source=script)
    client.gui._websock_interface.queue_message(message)
