"""The report of a dataset: one self-contained HTML page."""

from pathlib import Path

from t2twin.core import arguments
from t2twin.report.dataset import contents, forces, pairs, scan
from t2twin.report.dataset.tables import read_dataset
from t2twin.report.html.page import Sections, check_out, write_page

LINKS = {
    "shapes": "Pairs by shape",
    "gallery": "Images",
    "pairs": "Pairs",
    "forces": "Forces, depths, counts",
    "saturation": "Saturation",
    "duplicates": "Near-duplicates",
}


def write_data_report(out: str | Path, data: str | Path) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    data: a finished dataset, simulated or imported. Raises T2TwinError, before anything is written,
    if the dataset or the folder cannot be used.
    """
    out, data = arguments.path(out, "out"), arguments.path(data, "data")
    check_out(out)
    dataset = read_dataset(data)
    scanned = scan.scan(dataset, scan.noise_grey(dataset))
    values = {
        "summary": lambda: contents.summary(dataset, scanned),
        "about": lambda: contents.about(dataset),
        "shapes": lambda: contents.shapes(dataset),
        "gallery": lambda: contents.images(dataset),
        "pairs": lambda: pairs.section(dataset),
        "forces": lambda: forces.section(dataset),
        "saturation": lambda: contents.saturation_chart(dataset),
        "duplicates": lambda: scan.duplicates(dataset, scanned),
    }
    if not dataset.info.is_simulated:
        del values["forces"]  # imported pairs have neither contact forces nor depths
    sections: Sections = {
        name: (f"report/templates/dataset/{name}.html", compute) for name, compute in values.items()
    }
    return write_page(out, f"The dataset in {data}", sections, LINKS, dataset=dataset)
