"""Train and evaluate the skills; all commands resume where they were stopped.

    python -m examples.skills train OUT
    python -m examples.skills evaluate OUT

`train` shows each task to networks on the counts of a CySkin, on the images of a DIGIT, on these
images as counts, and without touch. `evaluate` runs them on objects that no training has, the first
one also with a DIGIT and a GelSight Mini. It writes OUT/skills.json. Pretrained networks translate
images into counts.
"""

import json
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
import tyro
from PIL import Image, ImageDraw
from safetensors.torch import load_file, save_file
from scipy.stats import binomtest
from tqdm import tqdm

import t2twin
from examples.skills.envs import RATE_HZ, TASKS, PoseEnv, SkillEnv
from examples.skills.learn import Policy, learn, small_change
from t2twin.core.files import atomic_write, new_folder
from t2twin.core.machine import cores
from t2twin.sim.dataset.lerobot import Feature, Part, write_lerobot

EPISODES, UNSEEN_FROM = {"hold": 400, "pose": 1200, "insert": 400}, 1_000_000
"""Episodes in training, and first seed of the evaluation."""
EPOCHS = {"counts": 150, "none": 80, "image": 40, "translated": 150}
SHOWN = {"cyskin-20": ("counts", "none"), "digit": ("image", "translated")}
"""The sensor of the expert, and what policies learn from its episodes."""
NOISE = 0.2  # standard deviation of the noise on the expert's actions, of half their range
RUNS = {"digit": "field", "gelsight-mini": "mini"}  # that translate images
Folder = tyro.conf.Positional[Path]


class Arm(NamedTuple):
    """A sensor, and what its policy learned from."""

    sensor: str
    policy: str


ARMS = {
    "CySkin": Arm("cyskin-20", "counts"),
    "DIGIT, translated": Arm("digit", "counts"),
    "GelSight Mini, translated": Arm("gelsight-mini", "counts"),
    "DIGIT, learned on images": Arm("digit", "image"),
    "no touch": Arm("cyskin-20", "none"),
    "DIGIT, learned translated": Arm("digit", "translated"),
    "CySkin, learned with a DIGIT": Arm("cyskin-20", "translated"),
}


@cache
def environment(task: str, sensor: str, unseen: bool, blind: bool = False) -> SkillEnv:
    """An environment, made once in a process. blind: whether no sensor is read."""
    return TASKS[task](sensor, () if blind else ("image" if sensor in RUNS else "counts",), unseen)


load_run = cache(t2twin.load)


@cache
def load_policy(path: Path) -> Policy:
    """A trained policy, read once in a process."""
    task, kind = path.stem.split("-")
    policy = Policy(kind, TASKS[task]().action_space)
    policy.load_state_dict(load_file(path))
    return policy


def touch_of(
    policy: str, sensor: str, observed: Any, background: Any
) -> tuple[np.ndarray, list[bool]]:
    """What a policy gets, and of each translated image whether it is out of distribution."""
    if policy == "none":
        return np.zeros((2, 0), np.float32), []
    if sensor not in RUNS:
        return observed["counts"], []
    pairs = zip(observed["image"], background, strict=True)
    if policy == "image":
        return np.stack([small_change(*pair) for pair in pairs]), []
    found = [load_run(RUNS[sensor]).estimate(*pair) for pair in pairs]
    unlike = [each.ood_class.inside is False for each in found]
    return np.stack([each.counts for each in found]), unlike


def demonstrate(task: str, sensor: str, seed: int, path: Path) -> None:
    """Write an episode of the expert, whose actions are disturbed."""
    env, rng = environment(task, sensor, False), np.random.default_rng(seed)
    observed, info = env.reset(seed=seed)
    background, rows, noise, is_over = info.get("background"), [], 0.0, False
    half = (env.action_space.high - env.action_space.low) / 2
    while not is_over:
        row = {each: touch_of(each, sensor, observed, background)[0] for each in SHOWN[sensor]}
        rows.append(row | {"hand": observed["hand"], "actions": np.float32(env.expert())})
        noise = 0.7 * noise + 0.7 * NOISE * half * rng.normal(size=half.size)
        observed, _, ended, is_last, _ = env.step(rows[-1]["actions"] + noise)
        is_over = ended or is_last
    columns: Any = {key: np.stack([row[key] for row in rows]) for key in rows[0]}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **columns)


def teach(task: str, kind: str, paths: list[Path], path: Path) -> None:
    """Write a policy that learned from demonstrations."""
    torch.manual_seed(0)
    policy = Policy(kind, TASKS[task]().action_space)
    learn(policy, [dict(np.load(each)) for each in paths], EPOCHS[kind])
    with atomic_write(path) as temporary:
        save_file(policy.state_dict(), temporary)


def perform(task: str, name: str, seed: int, path: Path, policies: Path, watch: Any = None) -> None:
    """Write what became of an episode with a policy. watch: is called before each action."""
    started, (sensor, learned) = time.process_time(), ARMS[name]
    env, policy = (
        environment(task, sensor, True),
        load_policy(policies / f"{task}-{learned}.safetensors"),
    )
    observed, info = env.reset(seed=seed)
    background, state, unlike, errors, is_over = info.get("background"), None, [], [], False
    while not is_over:
        if watch is not None:
            watch(env, observed)
        touch, of_images = touch_of(learned, sensor, observed, background)
        action, state = policy.act(touch, observed["hand"], state)
        observed, _, ended, is_last, info = env.step(action)
        unlike += of_images
        errors.append(info["errors"].tolist())
        is_over = ended or is_last
    found = {"success": info["success"], "object": env.kind, "errors": errors, "unlike": unlike}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(found | {"seconds": time.process_time() - started}))


def prepare() -> None:
    """Of a worker: one thread, and no warnings of single readings."""
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")


def run_all(function: Any, calls: dict[Path, Any], workers: int, what: str = "episodes") -> None:
    """Call a function in processes where its file is missing; shows progress."""
    missing = {path: call for path, call in calls.items() if not path.exists()}
    for folder in {path.parent for path in missing}:
        folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(workers, get_context("spawn"), prepare) as pool:
        futures = [pool.submit(function, *call) for call in missing.values()]
        for future in tqdm(as_completed(futures), what, len(futures), smoothing=0.02):
            future.result()


def train(
    out: Folder, tasks: tuple[str, ...] = tuple(TASKS), share: float = 1.0, workers: int = cores()
) -> None:
    """Write OUT/demonstrations and OUT/policies. share: of the demonstrations."""
    calls = {}
    for task in tasks:
        for sensor in SHOWN:
            for seed in range(round(EPISODES[task] * share)):
                path = out / "demonstrations" / f"{task}-{sensor}" / f"{seed:05}.npz"
                calls[path] = task, sensor, seed, path
    run_all(demonstrate, calls, workers)
    policies = {}
    for task in tasks:
        for sensor, kinds in SHOWN.items():
            paths = [path for path, call in calls.items() if call[:2] == (task, sensor)]
            for kind in kinds:
                path = out / "policies" / f"{task}-{kind}.safetensors"
                policies[path] = task, kind, paths, path
    run_all(teach, policies, workers, "policies")


def check_trained(folder: Path) -> None:
    if not folder.is_dir():
        raise SystemExit(f"{folder} does not exist; run `python -m examples.skills train` first")


def evaluate(
    out: Folder, tasks: tuple[str, ...] = tuple(TASKS), episodes: int = 200, workers: int = cores()
) -> None:
    """Perform the episodes that are not in OUT/episodes yet, and write OUT/skills.json."""
    check_trained(out / "policies")
    calls = {}
    for seed in range(UNSEEN_FROM, UNSEEN_FROM + episodes):
        for task in tasks:
            for name in ARMS:
                path = out / "episodes" / f"{task}, {name}" / f"{seed}.json"
                calls[path] = task, name, seed, path, out / "policies"
    run_all(perform, calls, workers)
    found: dict[str, Any] = {task: {} for task in tasks}
    for task in tasks:
        for name in ARMS:
            paths = (path for path, call in calls.items() if call[:2] == (task, name))
            each = found[task][name] = summary([json.loads(path.read_text()) for path in paths])
            low, high = each["interval_percent"]
            print(f"{task:8} {name:30} {each['success_percent']:4.0f} % ({low:.0f} to {high:.0f})")
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

    check_trained(out / "policies")
    strips: dict[str, list[Image.Image]] = {name: [] for name in list(ARMS)[:3]}

    def watch(env: SkillEnv, observed: Any) -> None:
        env.model.light_castshadow[:] = 0
        show = SceneRenderer(env.model)
        show.camera.lookat[:], show.camera.distance = [0, 0, 0.06], 0.22
        show.camera.azimuth, show.camera.elevation = 55, -15
        frame = Image.fromarray(show.render(env.data).copy())
        show.close()
        if "image" in observed:
            frame.paste(Image.fromarray(observed["image"][0]).resize((72, 96)), (6, 234))
        ImageDraw.Draw(frame).text((8, 6), name, fill=(0, 0, 0))
        strips[name].append(frame)

    for name in strips:
        perform(task, name, seed, out / "picture.json", out / "policies", watch)
    last = max(map(len, strips.values()))
    rows = [[each[min(n, len(each) - 1)] for each in strips.values()] for n in range(last)]
    pages = [Image.fromarray(np.hstack([np.asarray(each) for each in row])) for row in rows]
    pages[-1].save(out / f"{task}.png")
    write_animation(out / f"{task}.gif", pages, RATE_HZ)


def lerobot(out: Folder, task: str = "insert", sensor: str = "cyskin-20") -> None:
    """Write OUT/TASK-SENSOR-lerobot, the demonstrations in LeRobot's format v3.0."""
    folder = out / "demonstrations" / f"{task}-{sensor}"
    check_trained(folder)
    paths = sorted(folder.glob("*.npz"))
    episodes = [dict(np.load(path)) for path in paths]
    columns = {key: np.concatenate([each[key] for each in episodes]) for key in episodes[0]}
    touch = columns["counts" if "counts" in columns else "translated"]
    state = np.hstack([columns["hand"], touch.reshape(len(touch), -1)])
    part = {"observation.state": state, "action": columns["actions"]}
    features = [Feature(name, "float32", each.shape[1:], None) for name, each in part.items()]
    parts = [Part("train", part, [(task, len(each["hand"])) for each in episodes])]
    with new_folder(out / f"{task}-{sensor}-lerobot") as temporary:
        write_lerobot(temporary, features, parts, len(state), int(RATE_HZ))


def main() -> None:
    commands = {"train": train, "evaluate": evaluate, "picture": picture, "lerobot": lerobot}
    tyro.extras.subcommand_cli_from_dict(commands)
