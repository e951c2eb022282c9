"""The environments of examples/skills, their learner and their study."""

import numpy as np
import pytest

gym = pytest.importorskip("gymnasium")
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.mark.parametrize("task", ["hold", "pose", "insert"])
def test_a_seed_determines_an_episode(task):
    from examples.skills.envs import TASKS

    def episode(env, seed):
        observed = [env.reset(seed=seed)[0], env.step(env.expert())[0]]
        assert all(each in env.observation_space for each in observed)
        return b"".join(value.tobytes() for each in observed for value in each.values())

    env, other = (TASKS[task](observe=("counts", "contact", "traction")) for _ in range(2))
    first = episode(env, 3)
    assert episode(env, 3) == episode(other, 3) == first != episode(env, 4)


def test_processes_give_the_episodes_of_one_and_images_only_if_observed():
    from examples.skills.envs import PoseEnv

    options = {"sensor": "digit", "observe": ("image",)}
    envs = gym.make_vec("skills/Pose-v0", 2, vectorization_mode="async", **options)
    both, info = envs.reset(seed=[5, 6])
    envs.close()
    one, own = PoseEnv(**options).reset(seed=6)
    assert np.array_equal(both["image"][1], one["image"])
    assert np.array_equal(info["background"][1], own["background"])
    blind = PoseEnv("digit", ("contact",))
    contact = blind.reset(seed=6)[0]["contact"]
    assert blind.sensors[0].read(blind.model, blind.data).image is None
    assert contact[:, 0] == pytest.approx([6.0, 6.0], rel=0.1)  # the grip, N


def test_a_place_is_learned_from_counts(tmp_path, monkeypatch):
    from examples.skills import study

    rng, space = np.random.default_rng(0), gym.spaces.Box(np.float32([-1]), np.float32([1]))
    places = rng.uniform(-1, 1, (256, 1, 1)).astype(np.float32)
    counts = 4000 * np.exp(-((np.linspace(-1, 1, 5) - places[..., None]) ** 2))
    touches = np.repeat(counts, 2, axis=2).astype(np.float32)
    hand = np.zeros((1, 4), np.float32)
    shown = [
        {"counts": each, "hand": hand, "actions": own}
        for each, own in zip(touches, places, strict=True)
    ]
    study.torch.manual_seed(0)
    policy = study.Policy("counts", space)
    study.learn(policy, shown, 60)
    found = [policy.act(each[0], hand[0], None)[0] for each in touches]
    assert np.abs(np.ravel(found) - places.ravel()).max() < 0.3
