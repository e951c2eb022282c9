"""The environments of examples/skills, and their learner."""

import numpy as np
import pytest

gym = pytest.importorskip("gymnasium")
envs = pytest.importorskip("examples.skills.envs")
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.mark.parametrize("task", ["hold", "pose", "insert"])
def test_a_seed_determines_an_episode(task):
    def episode(env, seed):
        observed = [env.reset(seed=seed)[0], env.step(env.expert())[0]]
        assert all(each in env.observation_space for each in observed)
        return b"".join(value.tobytes() for each in observed for value in each.values())

    env, other = (envs.TASKS[task](observe=("counts", "contact", "traction")) for _ in range(2))
    assert episode(env, 3) == episode(env, 3) == episode(other, 3) != episode(env, 4)


def test_processes_give_the_episodes_of_one_and_images_only_if_observed():
    options = {"sensor": "digit", "observe": ("image",)}
    both = gym.make_vec("skills/Pose-v0", 2, vectorization_mode="async", **options)
    found, info = both.reset(seed=[5, 6])
    both.close()
    one, own = envs.PoseEnv(**options).reset(seed=6)
    assert np.array_equal(found["image"][1], one["image"])
    assert np.array_equal(info["background"][1], own["background"])
    blind = envs.PoseEnv("digit", ("contact",))
    grip_n = blind.reset(seed=6)[0]["contact"][:, 0]
    assert blind.sensors[0].read(blind.model, blind.data).image is None
    assert grip_n == pytest.approx([6.0, 6.0], rel=0.1)


def test_a_place_is_learned_from_counts():
    from examples.skills.learn import Policy, learn, torch

    rng, space = np.random.default_rng(0), gym.spaces.Box(-1, 1, (1,))
    places = rng.uniform(-1, 1, (256, 1, 1)).astype(np.float32)
    counts = 4000 * np.exp(-((np.linspace(-1, 1, 5, dtype=np.float32) - places[..., None]) ** 2))
    touch, hand = np.repeat(counts, 2, axis=2), np.zeros((1, 4), np.float32)
    torch.manual_seed(0)
    policy = Policy("counts", space)
    shown = zip(touch, places, strict=True)
    learn(policy, [{"counts": each, "hand": hand, "actions": own} for each, own in shown], 60)
    found = [policy.act(each[0], hand[0], None)[0] for each in touch]
    assert np.abs(np.ravel(found) - places.ravel()).max() < 0.3
