"""Tables of the documents, made from the results files."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from benchmarks.documents.formats import formatted
from benchmarks.documents.renames import renames
from benchmarks.evidence.record import RESULTS, find_benchmarks
from benchmarks.evidence.results import read_results
from t2twin.translate.evaluation.metrics.baselines import PAPER
from t2twin.translate.evaluation.metrics.forces import MEAN_ARRAY_OF_FORCE

ROWS = {
    "mean-array": "mean array",
    "nearest-neighbour": "nearest neighbor",
    "noise-floor": "noise floor",
    "touch2touch": "touch2touch",
    "resnet18": "ResNet18",
}
"""Rows of the paper's evaluation and what they are called."""

NAMES = ROWS | {"field": "field"}
"""The same of any evaluation."""

HARDWARE = {
    "touch2touch": "*touch2touch, Grella et al. 2023, hardware*",
    "resnet18": "*ResNet18, the same*",
}
"""The paper's rows."""

SPLITS = {"val": "validation", "test": "objects"}

BY_SHAPE = ("mean-array", "nearest-neighbour", "touch2touch", "resnet18")

ERRORS = {
    "depth_error": ("depth", ".1%"),
    "surface_error": ("surface over the pad, relative L2", ".1%"),
    "pressure_error": ("pressure at 1 mm, relative L2", ".1%"),
    "pad_error": ("taxel pads' mean pressure, of the largest pad", ".1%"),
    "force_error": ("force carried", ".2%"),
    "halved_grid": ("depth when all grids are halved", ".1%"),
    "orientations": ("depth at 8 N over the protocol's 12 orientations, from its mean", ".1%"),
}
"""The press's errors: what they are called, and their formats."""

STAGES = {
    "press_digit": "press, DIGIT",
    "press_cyskin": "press, CySkin",
    "picture": "picture",
    "pairs": "pairs, scale small, one worker",
}
"""What `speed` times, and what it is called; the last as a rate."""

PARTS = {
    "press": "a press, mean",
    "transforms": "transforms of the layer's answer",
    "mujoco": "MuJoCo's steps",
    "footprints": "looking the shape up",
    "means_over_pins": "the stiffening law, and means over pins",
    "rest": "all else",
    "floor": "transforms and MuJoCo alone, the floor",
}
"""What a press's time is made of, as `speed` has it."""

MANY_PAIRS, SHARD_PAIRS = 10_000_000, 588
"""Of the dataset that clusters.md reckons, and of a primitive's shard at the paper's scale."""

FEW_CORES, SOME_CORES, MANY_CORES = 2, 64, 1000
"""Cores that it reckons with."""


def results() -> str:
    """The README's table: every row on both splits, and the paper's."""
    content = _content("translation")
    heads = [f"{name}: counts | % | SSIM | contact IoU" for name in SPLITS.values()]
    lines = [["", *" | ".join(heads).split(" | ")]]
    for row, name in ROWS.items():
        cells = [name]
        for split in SPLITS:
            figures, interval = content[split][row]["overall"], content[split][row]["interval"]
            counts = f"{figures['rmse_counts']:,.0f}"
            if row != "noise-floor":
                low, high = interval["rmse_counts"]
                counts += f" ({low:,.0f}-{high:,.0f})"
            cells += [counts, f"{figures['rmse_percent']:.2f}", f"{figures['ssim']:.3f}"]
            cells += [f"{figures['contact_iou']:.3f}"]
        lines.append(cells)
    for model, name in HARDWARE.items():
        cells = [name]
        for split in SPLITS:
            paper = PAPER[split][model]
            cells += [f"{paper.rmse_counts:,.0f}", f"{paper.rmse_percent:.2f}"]
            cells += ["" if paper.ssim is None else f"{paper.ssim:.2f}", ""]
        lines.append(cells)
    return _markdown(lines)


def objects() -> str:
    """The RMSE of every row by object, in percent of full scale."""
    rows = _content("translation")["test"]
    lines = [["", *(ROWS[name] for name in BY_SHAPE)]]
    for shape in rows[BY_SHAPE[0]]["by_shape"]:
        errors = (rows[name]["by_shape"][shape]["rmse_percent"] for name in BY_SHAPE)
        lines.append([shape, *(f"{error:.2f}" for error in errors)])
    errors = (rows[name]["overall"]["rmse_percent"] for name in BY_SHAPE)
    lines.append(["all", *(f"{error:.2f}" for error in errors)])
    return _markdown(lines)


def worlds() -> str:
    """The RMSE on the paper's sets of runs of several worlds, in percent of full scale."""
    content = _content("world_runs")
    on_paper = content["on"]["paper"]
    lines = [["trained on", "pairs", "steps", "", *SPLITS.values()]]
    for name, run in content["runs"].items():
        if name not in on_paper["val"]:
            continue
        model = name.partition("-of-")[0]
        cells = [f"`{run['world']}`", f"{run['pairs']:,}", f"{run['steps']:,}", NAMES[model]]
        lines.append([*cells, *(_percent(on_paper[split][name]) for split in SPLITS)])
    for name in BY_SHAPE[:2]:
        lines.append(["", "", "", ROWS[name], *(_percent(on_paper[s][name]) for s in SPLITS)])
    return _markdown(lines)


def forces() -> str:
    """The RMSE by force on the hand tools, in percent of full scale, and beside that of the mean
    array of the same force."""
    rows = _content("world_runs")["on"]["forces"]["test"]
    runs = [name for name in rows if name.partition("-of-")[0] in (*HARDWARE, "field")]
    lines = [["force, N", "mean array of that force"]]
    for name in runs:
        lines[0] += [NAMES[name.partition("-of-")[0]], "of the mean array's"]
    for number, trivial in enumerate(rows[MEAN_ARRAY_OF_FORCE]["by_force"]):
        cells = [f"{trivial['mean_n']:g}", f"{trivial['rmse_percent']:.2f}"]
        for name in runs:
            error = rows[name]["by_force"][number]["rmse_percent"]
            cells += [f"{error:.2f}", f"{100 * error / trivial['rmse_percent']:.0f} %"]
        lines.append(cells)
    return _markdown(lines)


DRAWN_ROWS = {
    "drawn": "drawn by the network",
    "nearest_neighbour": "nearest counts of the training",
    "mean_picture": "mean picture of the training",
    "untouched": "the untouched gel",
}
"""Rows of the benchmark other_way, and what they are called."""


def other_way() -> str:
    """How near pictures drawn of counts are to the real ones."""
    content = _content("other_way")
    heads = [f"{name}: PSNR dB | SSIM | RMSE %" for name in SPLITS.values()]
    lines = [["", *" | ".join(heads).split(" | ")]]
    for row, name in DRAWN_ROWS.items():
        cells = [name]
        for split in SPLITS:
            figures = content[split]["rows"][row]
            for figure, form in (("psnr_contact_db", ".1f"), ("ssim_contact", ".2f")):
                cells.append(_with_interval(figures, figure, form))
            cells.append(f"{figures['overall']['rmse_percent']:.2f}")
        lines.append(cells)
    return _markdown(lines)


def details() -> str:
    """How much of the real pictures' detail is drawn right, by its size."""
    content = _content("other_way")
    sizes = [f"{size:g}" for size in content["details_mm"]]
    words = [f"coarser than {sizes[0]} mm"]
    words += [f"{low} to {high} mm" for high, low in pairwise(sizes)]
    lines = [["detail"], *([word] for word in (*words, f"finer than {sizes[-1]} mm"))]
    for split, name in SPLITS.items():
        for row in ("drawn", "nearest_neighbour"):
            lines[0].append(f"{name}: {DRAWN_ROWS[row].split(' ')[0]}")
            for line, part in zip(lines[1:], content[split]["explained"][row], strict=True):
                line.append(f"{100 * part:.0f} %")
    return _markdown(lines)


def shape_loss() -> str:
    """touch2touch with and without a loss of shape."""
    content = _content("shape_loss")
    forms = {"contact_iou": ".3f", "ssim": ".3f", "rmse_percent": ".2f"}
    heads = [f"{name}: contact IoU | SSIM | RMSE %" for name in SPLITS.values()]
    lines = [["", *" | ".join(heads).split(" | ")]]
    for kind, name in (("plain", "without"), ("shaped", "with")):
        for seed, number in enumerate(content["seeds"]):
            each = [content[split][kind]["runs"][seed] for split in SPLITS]
            cells = [f"{one[figure]:{form}}" for one in each for figure, form in forms.items()]
            lines.append([f"{name}, seed {number}", *cells])
    gains = [content[split]["gain"] for split in SPLITS]
    cells = [_with_interval(one, f, f"+{form}") for one in gains for f, form in forms.items()]
    lines.append(["with less without", *cells])
    return _markdown(lines)


def _with_interval(figures: dict[str, Any], name: str, form: str) -> str:
    """A figure and its interval, as in "27.5 (26.4 to 28.6)"."""
    value, between = figures["overall"][name], figures["interval"][name]
    if between is None:
        return f"{value:{form}}"
    low, high = between
    return f"{value:{form}} ({low:{form}} to {high:{form}})"


def saturation() -> str:
    """The largest taxel by force, of random shapes' presses and the tools'."""
    by_force = _content("random_presses")["by_force"]
    lines = [["force, N", *(f"{kind}: median counts | saturated" for kind in by_force)]]
    lines = [" | ".join(lines[0]).split(" | ")]
    for rows in zip(*by_force.values(), strict=True):
        cells = [f"{rows[0]['low_n']:g} to {rows[0]['high_n']:g}"]
        for row in rows:
            cells += [f"{row['median_counts']:,.0f}", f"{row['saturated_percent']:.1f} %"]
        lines.append(cells)
    return _markdown(lines)


def real() -> str:
    """What translators make of a real DIGIT's frames."""
    content = _content("real")
    lines = [
        [
            "",
            "real frames",
            "simulated",
            "centroid, mm",
            "one region",
            "force error",
            "coverage",
            "background",
        ]
    ]
    for name, run in content["runs"].items():
        model, _, world = name.partition("-of-")
        scores = run["real"]
        lines.append(
            [
                f"{NAMES[model]}, trained on `{world}`",
                f"{scores['rmse_percent']:.2f}",
                f"{run['simulated']['rmse_percent']:.2f}",
                f"{scores['centroid_mm']:.1f}",
                f"{scores['single_region']} of {len(content['presses'])}",
                f"{100 * scores['force_error']:.0f} %",
                "" if (held := scores["interval_coverage_percent"]) is None else f"{held:.0f} %",
                f"{run['background_counts']:,.0f}",
            ]
        )
    for name, row in (("zero counts", "zero"), ("mean array", "mean_array")):
        error = content[f"{row}_rmse_percent"]
        lines.append([name, f"{error:.2f}", f"{error:.2f}", "", "", "", "", ""])
    return _markdown(lines)


KINDS = {
    ("paper", "val"): "new versions of primitives, 8 N",
    ("paper", "test"): "hand tools, 8 N",
    ("open-8n", "val"): "random shapes, 8 N",
    ("dense", "val"): "new versions, read by 63 taxels",
    ("dense", "test"): "hand tools, read by 63 taxels",
    ("forces", "val"): "new versions, 1 to 12 N, any light",
    ("forces", "test"): "hand tools, 1 to 12 N, any light",
}
"""Presses that field runs are measured on, by dataset and split, and what they are called."""


def field() -> str:
    """Field runs on presses of many kinds."""
    content = _content("field")
    what = ("RMSE %", "contact IoU", "held %", "falls by %", "force off %")
    lines = [[""]]
    for run in content["runs"].values():
        lines[0] += [f"`{run['world']}`: {what[0]}", *what[1:]]
    for (data, split), kind in KINDS.items():
        cells = [kind]
        for name in content["runs"]:
            row = content["on"][data][split][name]
            overall, force = row["overall"], row["certainty"]["force_median_error_percent"]
            cells += [
                f"{overall['rmse_percent']:.2f}",
                f"{overall['contact_iou']:.3f}",
                f"{row['held_percent']:.1f}",
                f"{row['falls_by_percent']:.0f}",
                "" if force is None else f"{force:.1f}",
            ]
        lines.append(cells)
    cells = ["probes, 8 N"]
    for probes in content["probes"].values():
        cells += [f"{probes['rmse_percent']:.2f}", "", f"{probes['held_percent']:.1f}", "", ""]
    return _markdown([*lines, cells])


def tenths() -> str:
    """What intervals of 90 % hold of each tenth of the hand tools' readings, the surest first."""
    content = _content("field")
    lines = [["", *map(str, range(1, 11)), "all"]]
    for name, run in content["runs"].items():
        row = content["on"]["paper"]["test"][name]
        held = [*row["tenths_held_percent"], row["held_percent"]]
        lines.append([f"`{run['world']}`, %", *(f"{each:.0f}" for each in held)])
    return _markdown(lines)


LIGHTS = {
    "shipped": "the light that ships, its own background",
    "shipped_on_own_background": "the light that ships, the unit's background",
    "nearest": "the drawn unit whose LEDs explain the background best",
    "nearest_bent": "the same, each color bent to it",
    "mean_of_nearest": "the mean of the {averaged} best",
    "mean_of_all": "the mean of all drawn units: `--background` alone",
    "fitted": "fitted to the first presses",
}
"""Lights of the benchmark untouched, and what they are called."""


def lights() -> str:
    """How near lights that were not fitted come to a real DIGIT's frames, beside one that was."""
    content = _content("untouched")
    held_out, first = content["held_out_presses"], content["first_presses"]
    lines = [["on the unit's background but for the first", "PSNR dB", "SSIM", "first presses, dB"]]
    for name, words in LIGHTS.items():
        cells = [words.format(**content), f"{held_out[name]['psnr_db']:.1f}"]
        cells.append(f"{held_out[name]['ssim']:.2f}")
        lines.append([*cells, f"{first[name]['psnr_db']:.1f}" if name in first else ""])
    nothing = content["do_nothing"]
    lines.append(["do nothing", f"{nothing['psnr_db']:.1f}", f"{nothing['ssim']:.2f}", ""])
    return _markdown(lines)


def anchors() -> str:
    """What is known of depth, force, scale and modulus with and without anchors, on twins."""
    content = _content("anchors")
    lines = [["", "scale off", "modulus off", "depths off", "range of a depth", "truths in range",
              "5 % too small", "5 % too large"]]  # fmt: skip
    for name, balls in (("one_ball", "one ball"), ("two_balls", "two balls")):
        lost_db = content[name]["lost_db"].values()
        for part, words in (
            ("stated", "as stated"),
            ("anchored", "3 displacements, 8 forces"),
        ):
            row = content[name][part]
            young = row["young_off_percent"]
            inside = row["depths_inside"] + row["forces_inside"]
            lines.append(
                [
                    f"{balls}, {words}",
                    f"{row['scale_off_percent']:.1f} %",
                    "" if young is None else f"{young:.1f} %",
                    f"{row['depth_off_percent']:.1f} %",
                    f"{row['depth_range']:.2f} times",
                    f"{inside} of {2 * row['presses']}",
                    *(f"{lost:.2f} dB" if part == "stated" else "" for lost in lost_db),
                ]
            )
    return _markdown(lines)


def _percent(row: dict[str, Any]) -> str:
    """A row's RMSE and its interval, in percent of full scale."""
    low, high = row["interval"]["rmse_percent"]
    return f"{row['overall']['rmse_percent']:.2f} ({low:.2f}-{high:.2f})"


def fidelity() -> str:
    """What the press is off by: the primitives' worst and, in brackets, the random shapes' median
    and worst."""
    sensors = _content("press")["sensors"]
    lines = [["", "DIGIT's gel", "CySkin's cover"]]
    for key, (name, form) in ERRORS.items():
        cells = [name]
        for sensor in ("digit", "cyskin"):
            worst, of_random = sensors[sensor]["worst"], sensors[sensor]["random"]
            if key not in worst:
                cells.append("")
            elif key not in of_random["worst"]:
                cells.append(formatted(worst[key], form))
            else:
                middle, most = (
                    formatted(of_random[part][key], form) for part in ("median", "worst")
                )
                cells.append(f"{formatted(worst[key], form)} ({middle}, {most})")
        lines.append(cells)
    return _markdown(lines)


def speed() -> str:
    """How much faster everything is than at the commit that `speed` was measured against."""
    content = _content("speed")
    lines = [["", "times as fast", "now"]]
    for stage, name in STAGES.items():
        now = f"{content['ms'][stage]:.1f} ms" if stage in content["ms"] else ""
        lines.append([name, f"{content['times_as_fast'][stage]:.2f}", now])
    lines[-1][-1] = f"{content['pairs_a_second']:.0f} pairs/s"
    lines.append(["two workers over one", f"{content['two_workers_over_one']:.2f}", ""])
    return _markdown(lines)


def where() -> str:
    """Where a press's time goes."""
    content = _content("speed")["where_ms"]
    lines = [["ms of the processor", "DIGIT's gel", "CySkin's cover"]]
    for part, name in PARTS.items():
        lines.append([name, *(f"{content[sensor][part]:.1f}" for sensor in ("digit", "cyskin"))])
    return _markdown(lines)


def benchmarks() -> str:
    """Every benchmark: what it measures, its minutes, and where its figures are from."""
    lines = [["name", "what it measures", "minutes", "measured at"]]
    for benchmark in find_benchmarks().values():
        measured_on = read_results(benchmark.results).measured_on
        when = f"`{measured_on.commit}`, {measured_on.date[:10]}"
        lines.append([f"`{benchmark.name}`", benchmark.measures, f"{benchmark.minutes:g}", when])
    return _markdown(lines)


def many_pairs() -> str:
    """What MANY_PAIRS would take, by what the paper's dataset took."""
    content = _content("dataset")
    kb, run = content["kb_a_pair"], content["run"]
    hours = MANY_PAIRS * run["all_processor_ms_a_pair"] / 3.6e6
    gb = MANY_PAIRS * kb / 1e6
    worker_gib = run["peak_memory_gib"] / run["workers"]

    def written_mb_s(cores: int) -> float:
        return 1e3 * gb / (3600 * hours / cores)

    return _markdown(
        [
            ["", ""],
            [
                f"shards of {SHARD_PAIRS} pairs",
                f"{MANY_PAIRS / SHARD_PAIRS:,.0f} of {SHARD_PAIRS * kb / 1e3:.0f} MB",
            ],
            ["bytes", f"{gb:,.0f} GB ({1e9 * gb / 2**30:,.0f} GiB)"],
            [
                "processor time",
                f"{hours:,.0f} core-hours: {hours / FEW_CORES / 24:.1f} days on {FEW_CORES} cores, "
                f"{hours / SOME_CORES:.1f} h on {SOME_CORES}, "
                f"{60 * hours / MANY_CORES:.0f} min on {MANY_CORES:,}",
            ],
            [
                "written",
                f"{written_mb_s(SOME_CORES):.0f} MB/s with {SOME_CORES} cores, "
                f"{written_mb_s(MANY_CORES) / 1e3:.1f} GB/s with {MANY_CORES:,}",
            ],
            [
                "memory",
                f"{worker_gib:.1f} GiB a worker: {SOME_CORES * worker_gib:.0f} GiB with "
                f"{SOME_CORES}",
            ],
        ]
    )


TABLES: dict[str, Callable[[], str]] = {
    "results": results,
    "objects": objects,
    "worlds": worlds,
    "forces": forces,
    "saturation": saturation,
    "other-way": other_way,
    "details": details,
    "shape-loss": shape_loss,
    "real": real,
    "field": field,
    "tenths": tenths,
    "lights": lights,
    "anchors": anchors,
    "fidelity": fidelity,
    "speed": speed,
    "where": where,
    "benchmarks": benchmarks,
    "many-pairs": many_pairs,
    "renames": renames,
}
"""Tables by the names that documents call them by."""


def _content(name: str) -> dict[str, Any]:
    return read_results(RESULTS / f"{name}.json").content


def _markdown(lines: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; the first line is its head."""
    head, *body = (
        "|" + "".join(f" {cell} |" if cell else " |" for cell in cells) for cells in lines
    )
    return "\n".join([head, "|" + "---|" * len(lines[0]), *body])
