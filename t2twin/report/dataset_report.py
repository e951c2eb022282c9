"""The report of a dataset: one self-contained HTML page."""

from collections.abc import Callable
from pathlib import Path

from t2twin.core import arguments
from t2twin.report.dataset import contents, duplicates, forces, outliers, pairs, summary
from t2twin.report.dataset.scan import scan
from t2twin.report.dataset.tables import read_dataset
from t2twin.report.html.page import check_out, write_page

TITLE = "The dataset in {}"
LINKS = {
    "shapes": "Pairs by shape",
    "gallery": "Images",
    "pairs": "Pairs",
    "forces": "Forces, depths, counts",
    "saturation": "Saturation",
    "duplicates": "Near-duplicates",
    "outliers": "Outliers",
}


def write_data_report(out: str | Path, data: str | Path) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    data: a finished dataset, simulated or imported. Raises T2TwinError, before anything is written,
    if the dataset or the folder cannot be used.
    """
    out, data = arguments.path(out, "out"), arguments.path(data, "data")
    check_out(out)
    dataset = read_dataset(data)
    scanned = scan(dataset, duplicates.noise_grey(dataset))
    sections: dict[str, Callable[[], str]] = {
        "about": lambda: contents.about_section(dataset),
        "shapes": lambda: contents.shapes_section(dataset),
        "gallery": lambda: contents.gallery_section(dataset),
        "pairs": lambda: pairs.section(dataset),
        "forces": lambda: forces.section(dataset),
        "saturation": lambda: contents.saturation_section(dataset),
        "duplicates": lambda: duplicates.section(dataset, scanned),
        "outliers": lambda: outliers.section(dataset, scanned),
    }
    if not dataset.info.is_simulated:
        del sections["forces"]  # imported pairs have neither contact forces nor depths
    title = TITLE.format(data)
    return write_page(out, title, lambda: summary.section(dataset, scanned), sections, LINKS)
