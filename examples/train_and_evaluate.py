"""Train both translators of the paper on a dataset, and compare them with baselines.

python examples/train_and_evaluate.py --data data/small --minutes 2 --out runs/example

Without --data, the example makes the dataset of the demo first: 1,204 pairs.
"""

import argparse
from pathlib import Path

import t2twin


def main(data: Path, preset: str, minutes: float, out: Path) -> None:
    runs = []
    for model in ("touch2touch", "resnet18"):
        print(f"training {model} for about {minutes:g} minutes")
        t2twin.train(model, data, preset, out / model, minutes=minutes)
        runs.append(out / model)

    for split, content in (("val", "new versions of the shapes"), ("test", "hand tools")):
        evaluation = t2twin.evaluate(["field", *runs], data, split, out / f"evaluate-{split}")
        print(f"\nRMSE on {content}, percent of full scale:")
        for name, row in evaluation.models.items():
            print(f"{name:22} {row.overall['rmse_percent']:6.2f}")

    report = t2twin.write_report(out / "report", data, runs)
    print(f"\nwrote {report}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="a dataset of `t2twin simdata`")
    parser.add_argument("--preset", default="cpu", help="smoke, cpu or paper")
    parser.add_argument("--minutes", type=float, default=2.0, help="of each training")
    parser.add_argument("--out", type=Path, default=Path("runs/example"))
    arguments = parser.parse_args()
    dataset = arguments.data
    if dataset is None:
        dataset = Path("data/small")
        t2twin.make_dataset(dataset, scale="small")
    main(dataset, arguments.preset, arguments.minutes, arguments.out)
