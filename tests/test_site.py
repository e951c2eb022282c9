"""The documentation site, which `make docs` builds: what is added to the pages of docs/."""

from pathlib import Path

import yaml
from browser import browser

from maintenance.site import as_lists

ROOT = Path(__file__).parents[1]


def test_arguments_are_listed() -> None:
    docstring = "Summary.\n\nx_mm, y_mm: place.\n    More of it.\nforce: in N.\nReturns a number."
    assert as_lists(docstring) == (
        "Summary.\n\n\n- `x_mm, y_mm`: place.\n    More of it.\n- `force`: in N.\n\n"
        "Returns a number."
    )


def test_every_page_is_in_the_navigation() -> None:
    listed = str(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    for page in (ROOT / "docs").rglob("*.md"):
        assert page.relative_to(ROOT / "docs").as_posix() in listed, page


WORKER = "addEventListener('message', (event) => postMessage(2 * event.data));"
PAGE = """<!doctype html><script src="SCRIPT"></script><p></p><script>
const worker = new Worker("worker.js"), answers = [];
const show = (handler, event) => {
  answers.push(`${handler} ${event.data}`);
  document.querySelector("p").textContent = answers.sort().join(" ");
};
worker.onmessage = (event) => show("onmessage", event);
worker.addEventListener("message", (event) => show("listener", event));
worker.postMessage(21);
</script>"""


def test_a_page_opened_as_a_file_gets_answers_from_a_worker(tmp_path: Path) -> None:
    script = ROOT / "docs/javascripts/iframe-worker.js"
    (tmp_path / "worker.js").write_text(WORKER)
    (tmp_path / "page.html").write_text(PAGE.replace("SCRIPT", script.as_uri()))
    with browser() as chrome:
        page = chrome.new_page()
        page.goto((tmp_path / "page.html").as_uri())
        page.get_by_text("listener 42 onmessage 42", exact=True).wait_for()
