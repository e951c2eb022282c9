"""Train and evaluate the skills; both commands resume where they were stopped.

    python -m examples.skills train OUT
    python -m examples.skills evaluate OUT

`train` shows each task to a network on the counts of a CySkin, to one on the images of a DIGIT, and
to one without touch. `evaluate` runs them on objects that no training has, the first one also with
a DIGIT and a GelSight Mini, whose images pretrained networks translate into counts. It writes
OUT/skills.json.
"""

import json
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
import tyro
from PIL import Image, ImageDraw
from scipy.stats import binomtest
from tqdm import tqdm

import t2twin
from examples.skills.envs import RATE_HZ, TASKS, PoseEnv, SkillEnv
from examples.skills.learn import Policy, learn, small_change
from t2twin.core.files import atomic_write
from t2twin.core.machine import cores

EPISODES, CHUNK, UNSEEN_FROM = {"hold": 400, "pose": 1200, "insert": 400}, 10, 1_000_000
"""Episodes in training, episodes in a file, and first seed of the evaluation."""
EPOCHS = {"counts": 150, "translated": 150, "image": 40, "none": 80}
Folder = tyro.conf.Positional[Path]
NOISE = 0.2  # standard deviation of the noise on the expert's actions, of half their range


class Arm(NamedTuple):
    sensor: str
    observe: tuple[str, ...]
    run: str | None  # that translates images
    policy: str  # what it learned from


ARMS = {
    "own sensor": Arm("cyskin-20", ("counts",), None, "counts"),
    "DIGIT, translated": Arm("digit", ("image",), "field", "counts"),
    "GelSight Mini, translated": Arm("gelsight-mini", ("image",), "mini", "counts"),
    "DIGIT, learned on images": Arm("digit", ("image",), None, "image"),
    "no touch": Arm("cyskin-20", (), None, "none"),
    "DIGIT, learned translated": Arm("digit", ("image",), "field", "translated"),
    "CySkin, learned with a DIGIT": Arm("cyskin-20", ("counts",), None, "translated"),
}
SHOWN = {
    "none": "no touch", "counts": "own sensor", "image": "DIGIT, learned on images",
    "translated": "DIGIT, learned translated",
}  # fmt: skip
"""The arm whose episodes each policy learns from; the last one of a sensor observes all."""


@cache
def loaded(path: Path | str) -> Any:
    """A trained policy, or a pretrained run by its name; once in a process."""
    return t2twin.load(path) if isinstance(path, str) else Policy.load(path)


@cache
def environment(task: str, name: str, unseen: bool) -> SkillEnv:
    return TASKS[task](ARMS[name].sensor, ARMS[name].observe, unseen)


def touch_of(arm: Arm, observed: Any, background: Any) -> tuple[np.ndarray, list[bool]]:
    """What a policy gets, and of each translated image whether it is out of distribution."""
    if arm.policy == "none":
        return np.zeros((2, 0), np.float32), []
    if background is None:
        return observed["counts"], []
    pairs = zip(observed["image"], background, strict=True)
    if arm.run is None:
        return np.stack([small_change(*pair) for pair in pairs]), []
    found = [loaded(arm.run).classified_estimate(*pair) for pair in pairs]
    unlike = [each.ood_class.inside is False for each in found]
    return np.stack([each.counts for each in found]), unlike


def perform(
    task: str, name: str, seed: int, policy: Path | None = None, watch: Any = None
) -> dict[str, Any]:
    """One episode with a policy, on unseen objects; with None of the disturbed expert.

    watch: is called with the environment and the observation before each action.
    """
    started, arm, rng = time.process_time(), ARMS[name], np.random.default_rng(seed)
    env, state, noise = environment(task, name, policy is not None), None, 0.0
    observed, info = env.reset(seed=seed)
    background, rows, unlike, errors, is_over = info.get("background"), [], [], [], False
    half = (env.action_space.high - env.action_space.low) / 2
    while not is_over:
        if watch is not None:
            watch(env, observed)
        if policy is None:
            action, own = env.expert(), [ARMS[each] for each in SHOWN.values()]
            touches = {
                each.policy: touch_of(each, observed, background)[0]
                for each in own
                if each.sensor == arm.sensor
            }
            rows.append(touches | {"hand": observed["hand"], "actions": action})
            noise = 0.7 * noise + 0.7 * NOISE * half * rng.normal(size=half.size)
        else:
            touch, of_images = touch_of(arm, observed, background)
            unlike += of_images
            action, state = loaded(policy).act(touch, observed["hand"], state)
        observed, _, ended, is_last, info = env.step(action + noise)
        errors.append(info["errors"].tolist())
        is_over = ended or is_last
    found = {"task": task, "arm": name, "seed": seed, "object": env.kind, "errors": errors}
    found |= {"success": bool(info["success"]), "unlike": unlike, "rows": rows}
    return found | {"seconds": time.process_time() - started}


def demonstrate(task: str, name: str, seeds: range, path: Path) -> None:
    """Write episodes of the expert, padded to one length."""
    episodes, steps = [], TASKS[task].steps
    for seed in seeds:
        rows = perform(task, name, seed)["rows"]
        weights = (np.arange(steps) < len(rows)).astype(np.float32)
        rows += [rows[-1]] * (steps - len(rows))
        columns = {key: np.stack([row[key] for row in rows]) for key in rows[0]}
        episodes.append(columns | {"weights": weights})
    columns = {key: np.stack([each[key] for each in episodes]) for key in episodes[0]}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **columns)


def prepare() -> None:
    """Of a worker: one thread, and no warnings of single readings."""
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")


def results(workers: int, calls: list[tuple[Any, ...]], title: str) -> Iterator[Any]:
    """The results of calls, (function, arguments...), as processes return them; shows progress."""
    with ProcessPoolExecutor(workers, get_context("spawn"), prepare) as pool:
        futures = [pool.submit(*call) for call in calls]
        for future in tqdm(as_completed(futures), title, len(calls), smoothing=0.02):
            yield future.result()


def train(
    out: Folder, tasks: tuple[str, ...] = tuple(TASKS), share: float = 1.0, workers: int = cores()
) -> None:
    """Write OUT/demonstrations and OUT/policies. share: of the demonstrations."""
    files = {}
    for task in tasks:
        for name in {ARMS[name].sensor: name for name in SHOWN.values()}.values():
            starts = range(0, max(CHUNK, round(EPISODES[task] * share)), CHUNK)
            folder = out / "demonstrations" / f"{task}-{ARMS[name].sensor}"
            folder.mkdir(parents=True, exist_ok=True)
            files[task, name] = {range(n, n + CHUNK): folder / f"{n:05}.npz" for n in starts}
    calls = [(demonstrate, *key, *each) for key, paths in files.items() for each in paths.items()]
    calls = [call for call in calls if not call[-1].exists()]
    list(results(workers, calls, f"demonstrations, {CHUNK} episodes each"))
    (out / "policies").mkdir(exist_ok=True)
    for task, name in files:
        parts = [np.load(file) for file in files[task, name].values()]
        shown = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        for kind, own in SHOWN.items():
            path = out / "policies" / f"{task}-{kind}.safetensors"
            if path.exists() or ARMS[own].sensor != ARMS[name].sensor:
                continue
            torch.manual_seed(0)
            space, touch = TASKS[task]().action_space, shown[kind]
            policy = Policy(kind, touch.shape[-1], space.low, space.high)
            learn(policy, shown | {"touch": touch}, tqdm(range(EPOCHS[kind]), path.stem))
            with atomic_write(path) as temporary:
                policy.save(temporary)


def evaluate(
    out: Folder, tasks: tuple[str, ...] = tuple(TASKS), episodes: int = 200, workers: int = cores()
) -> None:
    """Perform the episodes that are not in OUT/episodes.jsonl yet, and write OUT/skills.json."""
    log, seeds = out / "episodes.jsonl", range(UNSEEN_FROM, UNSEEN_FROM + episodes)
    log.touch()
    whole = (line for line in log.read_text().splitlines() if line.endswith("}"))
    rows = [json.loads(line) for line in whole]
    known = {(row["task"], row["arm"], row["seed"]) for row in rows}
    wanted = [(task, name, seed) for seed in seeds for task in tasks for name in ARMS]
    calls = [
        (perform, *each, out / "policies" / f"{each[0]}-{ARMS[each[1]].policy}.safetensors")
        for each in wanted
        if each not in known
    ]
    with log.open("a") as file:
        print(file=file)  # ends a line that was cut off
        for row in results(workers, calls, "episodes"):
            print(json.dumps(row), file=file, flush=True)
            rows.append(row)
    found: dict[str, Any] = {task: {} for task in tasks}
    for task, name in dict.fromkeys(each[:2] for each in wanted):
        own = [row for row in rows if (row["task"], row["arm"]) == (task, name)]
        each = found[task][name] = summary([row for row in own if row["seed"] in seeds])
        low, high = each["interval_percent"]
        percent = f"{each['success_percent']:4.0f} % ({low:.0f} to {high:.0f})"
        print(f"{task:8} {name:28} {percent}")
    with atomic_write(out / "skills.json") as temporary:
        temporary.write_text(json.dumps(found, indent=1) + "\n")


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Success, %; errors of the pose; share of translated images that are out of distribution."""
    solved, objects = (np.array([row[key] for row in rows]) for key in ("success", "object"))
    unlike = np.concatenate([row["unlike"] for row in rows])
    found = success(solved) | {"unlike_percent": 100 * unlike.mean() if unlike.size else None}
    found["objects"] = {kind: success(solved[objects == kind]) for kind in sorted(set(objects))}
    for name, place in (("one_reading", 0), ("sequence", -1)):
        errors = np.array([row["errors"][place] for row in rows])
        if errors.size:
            medians = zip(("offset_mm", "angle_deg"), np.median(errors, 0).tolist(), strict=True)
            found[name] = success((errors < PoseEnv.TOLERANCE).all(axis=1)) | dict(medians)
    return found | {"seconds": float(np.mean([row["seconds"] for row in rows]))}


def success(solved: Any) -> dict[str, Any]:
    """The share of episodes that are solved, with its 95 % interval (Wilson)."""
    interval = binomtest(int(solved.sum()), solved.size).proportion_ci(0.95, "wilson")
    limits = [100 * interval.low, 100 * interval.high]
    percent = 100 * float(solved.mean())
    return {"episodes": solved.size, "success_percent": percent, "interval_percent": limits}


def picture(out: Folder, task: str = "insert", seed: int = UNSEEN_FROM) -> None:
    """Write OUT/TASK.gif and OUT/TASK.png: an episode with three sensors, side by side."""
    from examples.gripper_figure import SceneRenderer, write_animation

    strips: list[list[Image.Image]] = []
    for name, arm in list(ARMS.items())[:3]:
        frames: list[Image.Image] = []

        def watch(
            env: SkillEnv, observed: Any, frames: list[Any] = frames, name: str = name
        ) -> None:
            show = SceneRenderer(env.model)
            show.camera.lookat[:], show.camera.distance = [0, 0, 0.085], 0.26
            show.camera.azimuth, show.camera.elevation = 20, -10
            frame = Image.fromarray(show.render(env.data).copy())
            show.close()
            if "image" in observed:
                frame.paste(Image.fromarray(observed["image"][0]).resize((72, 96)), (6, 234))
            ImageDraw.Draw(frame).text((8, 6), name, fill=(0, 0, 0))
            frames.append(frame)

        perform(task, name, seed, out / "policies" / f"{task}-{arm.policy}.safetensors", watch)
        strips.append(frames)
    last = max(map(len, strips))
    rows = [[each[min(n, len(each) - 1)] for each in strips] for n in range(last)]
    pages = [Image.fromarray(np.hstack([np.asarray(each) for each in row])) for row in rows]
    pages[-1].save(out / f"{task}.png")
    write_animation(out / f"{task}.gif", pages, RATE_HZ)


def main() -> None:
    commands = {"train": train, "evaluate": evaluate, "picture": picture}
    tyro.extras.subcommand_cli_from_dict(commands)
