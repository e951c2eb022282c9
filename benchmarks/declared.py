"""Every benchmark's declaration: what it measures, its limits, and what its figures depend on."""

from pathlib import Path

from benchmarks.evidence.record import Argument, Benchmark, Figure

MIN_PSNR_DB, MIN_SSIM = 32.0, 0.95
"""Of the baked picture at the contact, against the rendered one."""

DRAWING = tuple(
    f"t2twin.report.{name}"
    for name in ("html.figures", "html.labels", "dataset.forces", "dataset.pairs")
)
"""Parts of the report that draw or write, and count nothing."""

PHYSICS = ("t2twin.sim.contact", "t2twin.sim.digit", "t2twin.sim.cyskin", "t2twin.primitives_cad")
"""What a training's or a frame's time does not depend on: the pairs' content."""

PRESS = Benchmark(
    name="press",
    measures="How far the press is from an independent solution of the contact, and how long it "
    "takes.",
    minutes=12,
    figures=(
        Figure("sensors.*.worst.depth_error", most=0.03),
        Figure("sensors.*.worst.surface_error", most=0.05),
        Figure("sensors.*.worst.pressure_error", most=0.05),
        Figure("sensors.cyskin.worst.pad_error", most=0.02),
        Figure("sensors.*.worst.force_error", most=0.001),
        Figure("sensors.*.random.within_limits_percent", "%", least=90.0),
        Figure("sensors.*.random.worst.*"),
        Figure("sensors.*.worst.halved_grid"),
        Figure("sensors.*.worst.orientations"),
        Figure("sensors.*.protocol.unsettled", most=0),
        Figure("sensors.*.protocol.median_ms", "ms"),
        Figure("sensors.*.protocol.p95_ms", "ms"),
        Figure("hertz_worst.depth_error", most=0.05),
        Figure("hertz_worst.peak_pressure_error", most=0.05),
        Figure("exponents.ball"),
        Figure("exponents.punch"),
    ),
    arguments=(
        Argument("--shapes", "take every Nth primitive only; keeps nothing", int, 1, thins=True),
    ),
)

DOME = Benchmark(
    name="dome",
    measures="What the gel's dome and free sides change, against finite elements of the real gel.",
    minutes=12,
    figures=(
        Figure("summary.flat.worst_depth_error"),
        Figure("summary.middle.median_surface_error"),
        Figure("summary.to_rim.*.worst_depth_error"),
        Figure("summary.to_rim.*.median_surface_error"),
        Figure("summary.to_rim.*.worst_surface_error"),
        Figure("protocol_near_rim.*.share_of_presses.2"),
        Figure("protocol_near_rim.*.share_of_force.2"),
    ),
    arguments=(
        Argument("--shapes", "take every Nth shape only; keeps nothing", int, 1, thins=True),
    ),
    confirmable=True,
)

DIGIT_RENDER = Benchmark(
    name="digit_render",
    measures="How near the baked DIGIT picture is to the rendered reference, and what each costs.",
    minutes=8,
    figures=(
        Figure("least_psnr_db", "dB", least=MIN_PSNR_DB),
        Figure("median_psnr_db", "dB"),
        Figure("least_ssim", least=MIN_SSIM),
        Figure("median_ssim"),
        Figure("baked_ms", "ms", most=5.0),
        Figure("baked_best_ms", "ms"),
        Figure("baked_noisy_ms", "ms"),
        Figure("reference_ms", "ms"),
        Figure("reference_over_baked"),
        Figure("tacto_over_baked"),
    ),
    arguments=(Argument("--presses", "how many; keeps nothing unless 100", int, 100, thins=True),),
)

PHI = Benchmark(
    name="phi",
    measures="What a tactile image costs, against scipy's LinearNDInterpolator.",
    minutes=0.2,
    figures=(
        Figure("phi_ms_an_image", "ms", most=0.2),
        Figure("ratio", least=10.0),
        Figure("batch_ratio"),
        Figure("largest_difference_counts", "counts"),
    ),
    shapes=False,
)

GAIN = Benchmark(
    name="gain",
    measures="The CySkin's gain that lets the training set's largest taxels just reach full scale.",
    minutes=9,
    figures=(
        Figure("gain_counts", "counts"),
        Figure("gain_counts_in_use", "counts"),
        Figure("saturated_share_in_use"),
    ),
    arguments=(
        Argument(
            "scale",
            "of the dataset; keeps nothing unless paper",
            default="paper",
            nargs="?",
            choices=("smoke", "small", "paper"),
            thins=True,
        ),
    ),
)

LATENCY = Benchmark(
    name="latency",
    measures="One DIGIT frame to its counts on one core, beside PyTorch and PyTorch as it comes.",
    minutes=2,
    figures=(
        Figure("presets.touch2touch-cpu.median_ms", "ms", most=30.0),
        Figure("presets.resnet18-cpu.median_ms", "ms", most=16.0),
        Figure("presets.field-cpu.median_ms", "ms", most=12.0),
        Figure("presets.touch2touch-paper.median_ms", "ms"),
        Figure("presets.resnet18-paper.median_ms", "ms"),
        Figure("presets.*.p95_ms", "ms"),
        Figure("presets.*.torch_ratio"),
        Figure("presets.*.plain_ratio"),
    ),
    apart_from=("t2twin.sim.contact", "t2twin.sim.digit", "t2twin.sim.dataset"),
    shapes=False,
)

TRAINING = Benchmark(
    name="training",
    measures="Training throughput against the loop that one would write first.",
    minutes=6,
    figures=(
        Figure("models.*.ratio", least=1.5),
        Figure("models.*.loading_share", most=0.1),
        Figure("models.*.images_a_second", "images/s"),
        Figure("models.*.paper_preset_hours", "h"),
    ),
    arguments=(
        Argument("--data", "a dataset, made at scale smoke unless given", Path, metavar="DIR"),
    ),
    apart_from=PHYSICS,
    shapes=False,
)

DATASET = Benchmark(
    name="dataset",
    measures="Whether a finished dataset is whole, sane, small and quickly made.",
    minutes=2,
    figures=(
        Figure("run.minutes", "minutes", most=15.0),
        Figure("run.pairs_a_second", "pairs/s"),
        Figure("run.peak_memory_gib", "GiB", most=4.0),
        Figure("rates.two_workers_over_one", least=1.8),
        Figure("size_gib", "GiB", most=1.5),
        Figure("near_duplicates_percent", "%", most=2.0),
        Figure("alike_but_felt_otherwise_percent", "%"),
        Figure("pairs_without_contact"),
        Figure("unsettled"),
        Figure("bottomed"),
        Figure("saturated_taxels_percent", "%"),
    ),
    arguments=(
        Argument("folder", "the dataset", Path),
        Argument(
            "--rates",
            "one dataset made twice in a row, with one worker and with two; the results keep the "
            "rates they have unless given",
            Path,
            nargs=2,
            metavar=("ONE", "TWO"),
        ),
    ),
    entries=("t2twin.sim.dataset.generate",),
    apart_from=DRAWING,
    times=("run", "rates"),
    confirmable=True,
)

TRANSLATION = Benchmark(
    name="translation",
    measures="The errors of trained translators beside the trivial rows and the floors.",
    minutes=4,
    figures=(
        # A quarter of the mean array's, and the nearest neighbor's, on validation; three quarters
        # of the better of the two on the objects.
        Figure("ratios.val.*.of_mean_array", most=0.25),
        Figure("ratios.val.*.of_nearest_neighbour", most=1.0),
        Figure("ratios.test.*.of_best_trivial", most=0.75),
        Figure("ratios.test.*.of_lookalikes"),
        Figure("val.*.overall.rmse_percent", "%"),
        Figure("test.*.overall.rmse_percent", "%"),
        Figure("runs.*.minutes", "minutes"),
    ),
    arguments=(
        Argument("data", "the dataset", Path),
        Argument("runs", "folders of t2twin train", Path, nargs="+"),
        Argument("--report", "the report's folder", Path, required=True, metavar="DIR"),
        Argument("--layouts", "evaluations on other layouts", Path, (), "*", metavar="DIR"),
    ),
    entries=("t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
    apart_from=(*DRAWING, "t2twin.report.sections.qualitative"),
    times=("runs.*.minutes",),
    confirmable=True,
)

PROBES = Benchmark(
    name="probes",
    measures="The errors of trained translators on solids made to choose settings by.",
    minutes=2,
    figures=(Figure("rows.*.all", "%"),),
    arguments=(
        Argument("runs", "folders of t2twin train", Path, nargs="+"),
        Argument("--data", "the dataset of the trivial rows", Path, required=True, metavar="DIR"),
        Argument(
            "--probes",
            "where the presses are kept",
            Path,
            Path("data/probes.npz"),
            metavar="FILE",
        ),
    ),
    entries=("t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
    confirmable=True,
)

KILLS = Benchmark(
    name="kills",
    measures="Whether a run of simdata that is killed again and again ends with the same bytes.",
    minutes=4,
    figures=(
        Figure("kills"),
        Figure("datasets"),
        Figure("datasets_unlike_undisturbed", most=0),
    ),
    arguments=(
        Argument("--kills", "how many; keeps nothing unless 20", int, 20, thins=True),
        Argument("--seed", "of the moments", int, 0),
    ),
    entries=("t2twin.cli.dataset", "t2twin.sim.dataset.generate"),
    shapes=False,
)

BAD_INPUTS = Benchmark(
    name="bad_inputs",
    measures="Whether every bad input to every command ends with one sentence, and leaves nothing.",
    minutes=4,
    figures=(
        Figure("tried", least=700),
        Figure("odd_but_fine"),
        Figure("unclean", most=0),
        Figure("connections", most=0),
        Figure("bombs_gib", "GiB", most=1.0),
        Figure("minutes", "minutes"),
    ),
    entries=("t2twin.cli", "t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
    shapes=False,
)

FAULTS = Benchmark(
    name="faults",
    measures="Whether a command that is killed, stopped or short of room loses or leaves anything.",
    minutes=12,
    figures=(Figure("tried", least=60), Figure("unclean", most=0)),
    arguments=(
        Argument("--seed", "of the moments", int, 0),
        Argument("--commands", "keeps nothing unless all", str, None, "*", metavar="NAME",
                 thins=True),
    ),
    entries=("t2twin.cli", "t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
    shapes=False,
)  # fmt: skip

CALIBRATION = Benchmark(
    name="calibration",
    measures="How near a calibration comes to frames of a real DIGIT that it was not fitted to.",
    minutes=1,
    figures=(
        Figure("scores.calibrated.psnr_db", "dB", least=30.5),
        Figure("scores.calibrated.ssim", least=0.87),
        Figure("scores.calibrated.l1", "grey levels"),
        # Nearer than cut and paste, or the model has learnt no optics.
        Figure("over_cut_and_paste.psnr_db", "dB", least=3.0),
        Figure("over_cut_and_paste.ssim", least=0.04),
        Figure("scores.do_nothing.psnr_db", "dB"),
    ),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
    apart_from=("t2twin.sim.digit.calibrate.uncertainty",),
    shapes=False,
)

ANCHORS = Benchmark(
    name="anchors",
    measures="What known displacements, forces and a second ball settle, on twins that are known.",
    minutes=6,
    figures=tuple(
        figure
        for balls in ("one_ball", "two_balls")
        for figure in (
            Figure(f"{balls}.lost_db.*", "dB"),
            Figure(f"{balls}.stated.depth_range"),
            Figure(f"{balls}.stated.depths_inside", least=8),
            Figure(f"{balls}.stated.forces_inside", least=8),
            Figure(f"{balls}.anchored.scale_off_percent", "%", most=2.0),
            Figure(f"{balls}.anchored.young_off_percent", "%", most=5.0),
            Figure(f"{balls}.anchored.depth_off_percent", "%", most=3.0),
            Figure(f"{balls}.anchored.depths_inside", least=8),
        )
    ),
)

UNTOUCHED = Benchmark(
    name="untouched",
    measures="How near a light guessed from a real DIGIT's background comes, and one that ships.",
    minutes=2,
    figures=(
        Figure("held_out_presses.*.psnr_db", "dB"),
        Figure("held_out_presses.*.ssim"),
        Figure("first_presses.*.psnr_db", "dB"),
        Figure("nearest_singly_psnr_db", "dB"),
        Figure("drawn_singly_psnr_db", "dB"),
    ),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
    apart_from=("t2twin.sim.digit.calibrate.uncertainty",),
    shapes=False,
)

REAL = Benchmark(
    name="real",
    measures="What trained translators make of frames of a real DIGIT.",
    minutes=2,
    figures=(
        Figure("runs.*.real.rmse_percent", "%"),
        Figure("runs.*.simulated.rmse_percent", "%"),
        Figure("runs.*.real.centroid_mm", "mm"),
        Figure("runs.*.real.force_error"),
        Figure("runs.*.background_counts", "counts"),
        Figure("zero_rmse_percent", "%"),
        Figure("mean_array_rmse_percent", "%"),
    ),
    arguments=(
        Argument("frames", "folder of background.png and press_*.png", Path),
        Argument("runs", "folders of trained runs", Path, nargs="+"),
    ),
)

UNITS = Benchmark(
    name="units",
    measures="Where a real DIGIT lies among drawn ones, and what a drawn one costs.",
    minutes=2,
    figures=(
        Figure("made_best_ms", "ms", most=10.0),
        Figure("parameters.*.real.percentile", "%"),
        Figure("pictures.*.*.mean", "grey levels"),
        Figure("pictures.*.real.mean_percentile", "%", most=95.0),
        Figure("pictures.*.real.nearest_percentile", "%", most=95.0),
        Figure("pictures.*.shipped.mean_percentile", "%", most=95.0),
    ),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
    apart_from=("t2twin.sim.digit.calibrate.uncertainty",),
    shapes=False,
)

PICTURES = Benchmark(
    name="pictures",
    measures="The README's picture of five presses.",
    minutes=0.3,
    figures=(
        Figure("presses.0.largest_counts", "counts"),
        Figure("presses.4.largest_counts", "counts"),
    ),
)

RANDOM_PRESSES = Benchmark(
    name="random_presses",
    measures="Random shapes pressed by the ten thousand, and whether the tools' presses lie among "
    "them.",
    minutes=10,
    figures=(
        Figure("presses"),
        Figure("exceptions", most=0),
        Figure("unsettled", most=0),
        Figure("drawn_again_percent", "%"),
        Figure("force_off_percent", "%", most=0.5),
        Figure("shape_over_its_presses", most=0.1),
        Figure("tail.*.p99_over_median", most=3.0),
        Figure("spread.*.tools_inside_percent", "%", least=95.0),
    ),
    arguments=(
        Argument("--presses", "how many; keeps nothing unless 20,500", int, 20_500, thins=True),
    ),
    entries=("t2twin.sim.world.presses",),
)

WORLD_RATE = Benchmark(
    name="world_rate",
    measures="How fast the open world's pairs are made, beside the protocol's.",
    minutes=8,
    figures=(
        Figure("open_over_protocol", least=0.85),
        Figure("protocol_pairs_a_second", "pairs/s"),
        Figure("open_pairs_a_second", "pairs/s"),
        Figure("kb_a_pair.*", "kB"),
    ),
    arguments=(Argument("--rounds", "turns of both", int, 1),),
    entries=("t2twin.sim.dataset.generate",),
)

SPEED = Benchmark(
    name="speed",
    measures="How much faster a press, a picture and a dataset are than at another commit.",
    minutes=20,
    figures=(
        Figure("times_as_fast.pairs", "times", least=2.0),
        Figure("times_as_fast.press_digit", "times", least=2.0),
        Figure("times_as_fast.press_cyskin", "times", least=2.2),
        Figure("times_as_fast.picture", "times", least=2.0),
        Figure("two_workers_over_one", "times", least=1.9),
        Figure("ms.*", "ms"),
        Figure("where_ms.*.*", "ms"),
        Figure("pairs_a_second", "pairs/s"),
    ),
    arguments=(
        Argument("checkout", "folder of another checkout of this project", Path),
        Argument("--turns", "of both; keeps nothing unless 5", int, 5, thins=True),
    ),
    entries=("t2twin.sim.dataset.generate",),
)

WORLD_RUNS = Benchmark(
    name="world_runs",
    measures="The errors of translators trained on one world and measured on others.",
    minutes=1,
    figures=(
        Figure("on.*.val.*.overall.rmse_percent", "%"),
        Figure("on.*.test.*.overall.rmse_percent", "%"),
    ),
    arguments=(Argument("evaluations", "folders of t2twin evaluate", Path, nargs="+"),),
    entries=("t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
)

FIELD = Benchmark(
    name="field",
    measures="Field runs on presses of many kinds: errors, intervals, sureness, force.",
    minutes=1,
    figures=(
        *(
            Figure(f"on.{kind}.*.{name}", "%")
            for kind in ("*.val", "paper.test", "dense.test", "forces.test")
            for name in ("overall.rmse_percent", "held_percent", "falls_by_percent")
        ),
        Figure("probes.*.rmse_percent", "%"),
        Figure("probes.*.held_percent", "%"),
        Figure("runs.*.minutes", "minutes"),
    ),
    arguments=(
        Argument("evaluations", "folders of t2twin evaluate", Path, nargs="+"),
        Argument("--runs", "folders of field runs", Path, nargs="+", required=True),
        Argument(
            "--begun-with",
            "folders of runs with whose weights those began",
            Path,
            nargs="*",
            default=[],
        ),
        Argument(
            "--probes",
            "where the probes' presses are kept",
            Path,
            Path("data/probes.npz"),
            metavar="FILE",
        ),
    ),
    entries=("t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
)

OTHER_WAY = Benchmark(
    name="other_way",
    measures="How near DIGIT pictures drawn of 20 counts are to the real ones.",
    minutes=2,
    figures=tuple(
        figure
        for split in ("val", "test")
        for figure in (
            Figure(f"{split}.rows.*.overall.psnr_contact_db", "dB"),
            Figure(f"{split}.rows.*.overall.ssim_contact"),
            Figure(f"{split}.rows.*.overall.rmse_percent", "%"),
            Figure(f"{split}.over_nearest.overall.psnr_contact_db", "dB"),
            Figure(f"{split}.over_nearest.overall.ssim_contact"),
            Figure(f"{split}.contact_percent", "%"),
        )
    ),
    arguments=(
        Argument("run", "folder of t2twin train --direction cyskin-to-digit", Path),
        Argument("--data", "the dataset", Path, required=True, metavar="DIR"),
    ),
    entries=("t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
    apart_from=(*DRAWING, "benchmarks.other_way_picture"),
)

SHAPE_LOSS = Benchmark(
    name="shape_loss",
    measures="What a loss of the tactile image's shape brings touch2touch.",
    minutes=4,
    figures=tuple(
        Figure(f"{split}.{part}.{name}", unit)
        for split in ("val", "test")
        for part in ("plain.mean", "shaped.mean", "gain.overall")
        for name, unit in (("contact_iou", ""), ("ssim", ""), ("rmse_percent", "%"))
    ),
    arguments=(
        Argument("--plain", "runs without", Path, nargs="+", required=True, metavar="RUN"),
        Argument("--shaped", "the same with", Path, nargs="+", required=True, metavar="RUN"),
        Argument("--data", "the dataset", Path, required=True, metavar="DIR"),
    ),
    entries=("t2twin.sim.dataset.generate", "t2twin.translate.training.train"),
)

REGRESSION = Benchmark(
    name="regression",
    measures="Both translators trained briefly on a small fixed dataset, held to a baseline.",
    minutes=8,
    figures=(
        # Runs on other processors and other numbers of threads differ by some percent; a broken
        # phi, loss or pairing by a factor.
        Figure("against.rmse_of_baseline.*.*", most=1.2),
        Figure("against.rmse_of_mean_array.val.*", most=0.5),
        Figure("against.rmse_of_mean_array.test.*", most=1.0),
        Figure("against.iou_below_baseline.*.*", most=0.05),
    ),
    baseline=True,
)

STUDIO = Benchmark(
    name="studio",
    measures="How soon the studio shows a press, how fast it follows, and what live frames cost.",
    minutes=5,
    figures=(
        Figure("start_s.first", "s", most=15.0),
        Figure("start_s.after", "s", most=5.0),
        Figure("core_median_ms", "ms", most=60.0),
        Figure("page_median_ms", "ms", most=100.0),
        Figure("events.exceptions", most=0),
        Figure("events.memory_grown_percent", "%", most=10.0),
        Figure("events.states_wrong", most=0),
        Figure("live.share_of_frames", least=0.98),
        Figure("live.latency_median_ms", "ms", most=20.0),
    ),
    arguments=(Argument("runs", "folders of t2twin train, ResNet18 first", Path, nargs="+"),),
    entries=("t2twin.cli.studio", "t2twin.cli.live"),
)

FIRST_PRESS = Benchmark(
    name="first_press",
    measures="How long `t2twin press` takes with an empty cache, and after that.",
    minutes=2,
    figures=(
        Figure("first.wall_s", "s", most=15.0),
        Figure("first.processor_s", "s"),
        Figure("later.wall_s", "s", most=2.0),
        Figure("later.processor_s", "s"),
    ),
    arguments=(Argument("rounds", "empty caches", int, 3, nargs="?"),),
    entries=("t2twin.cli.press",),
)

BENCHMARKS = (
    PRESS, DOME, DIGIT_RENDER, PHI, GAIN, LATENCY, TRAINING, KILLS, BAD_INPUTS, CALIBRATION,
    ANCHORS, UNTOUCHED, REAL, UNITS, PICTURES, REGRESSION, DATASET, TRANSLATION, PROBES,
    RANDOM_PRESSES, SPEED, WORLD_RATE, WORLD_RUNS, FIELD, OTHER_WAY, SHAPE_LOSS, STUDIO,
    FIRST_PRESS,
)  # fmt: skip
"""In the order in which they run."""
