"""Each value of a bundled sensor file has an effect on a reading, or its change is refused."""

# MuJoCo defines its names at import; `attach` takes a sensor as `load_sensor` does.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false

import copy
import tomllib
from collections.abc import Iterator
from functools import cache, reduce
from operator import getitem
from typing import Any

import mujoco
import numpy as np
import pytest

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Friction
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors.files import SPECS, Sensor, load_sensor

WORDS = ("square", "triangular", "round", "capacitive", "other")
BALL = ball(3.0)
FAST = ("cyskin-63", "gelsight-mini")  # sensors that `make test` tries


def values_of(content: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The place of each value in a file's content."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in pairs:
        if isinstance(value, dict | list):
            yield from values_of(value, (*place, key))
        else:
            yield *place, key


def edits(value: Any) -> list[Any]:
    """Other values of the same type: near a number, and farther, where counts are rounded."""
    if isinstance(value, str):
        return [word for word in WORDS if word != value]
    near = value or 1.0
    return [value + 1] if isinstance(value, int) else [1.1 * near, 1.5 * near]


def text_of(content: dict[str, Any], table: str = "") -> str:
    """TOML of a file's content: tables and lists of tables by their full names."""
    lines, tables = [], []
    for key, value in content.items():
        name = f"{table}.{key}" if table else key
        if isinstance(value, dict):
            tables.append(f"[{name}]\n{text_of(value, name)}")
        elif isinstance(value, list) and isinstance(value[0], dict):
            tables += [f"[[{name}]]\n{text_of(each, name)}" for each in value]
        else:
            lines.append(f"{key} = {repr(value).replace(chr(39), chr(34))}\n")
    return "".join(lines + tables)


@cache
def contacts(elastomer: t2twin.Elastomer, pitch_mm: float, friction: float) -> list[Any]:
    """A press, and the contact after a short slide, as a sensor makes them."""
    press = solve_contact(BALL, PressCommand("ball", 0.3, -0.2, 0.0, 30.0), elastomer, pitch_mm)
    return [press, advance(press, 0.5, 0.2, 0.0, 30.0, Friction(friction))]


def readings(sensor: Sensor) -> Iterator[Any]:
    """What a touch of a sensor gives, with the seeds of its noise fixed; the fastest first."""
    yield sensor.name, sensor.size
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="finger").add_site(name="pad")
    t2twin.attach(spec, site="pad", sensor=sensor)
    model = spec.compile()
    yield model.body_mass, model.geom_size, model.geom_rgba, model.body_inertia
    rng = np.random.default_rng
    if isinstance(sensor, GelCamera):
        yield sensor.image(None), sensor.image(None, rng(0))
        if sensor.spec.units is not None:
            yield sample_unit(rng(0), sensor.spec, UnitRanges()).optics.background
    for contact in contacts(sensor.elastomer, sensor.pitch_mm, sensor.friction.coefficient):
        yield contact.pressure_kpa, contact.surface_mm
        if isinstance(sensor, GelCamera):
            yield sensor.image(contact), sensor.with_options({"markers": True}).image(contact)
            continue
        reading: Any = sensor.read(contact)
        yield reading.counts, reading.tactile_image
        yield reading.dense_counts
        for name in sensor.spec.imperfections:
            array = sensor.with_options({"imperfections": name})
            pressed = array.read(contact, rng(0))
            released = array.read(None, rng(1), pressed)
            yield pressed.counts, released.counts, array.read(contact, rng(2), released).counts
            yield [array.read(None, rng(seed)).counts for seed in range(50)]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in FAST else pytest.mark.exhaustive)
        for name in t2twin.sensors()
    ],
)
def test_each_value_has_an_effect_or_is_refused(name, tmp_path):
    content = tomllib.loads((SPECS / f"{name}.toml").read_text())
    path, without_effect = tmp_path / "mine.toml", []
    path.write_text(text_of(content))
    before = [[np.asarray(each) for each in stage] for stage in readings(load_sensor(path))]
    for *to, last in values_of(content):
        changed = copy.deepcopy(content)
        table = reduce(getitem, to, changed)
        found = set()
        for value in edits(table[last]):
            table[last] = value
            path.write_text(text_of(changed))
            try:
                pairs = zip(before, readings(load_sensor(path)), strict=True)
                is_same = all(all(map(np.array_equal, *stages)) for stages in pairs)
                found.add("same" if is_same else "changed")
            except T2TwinError:
                found.add("refused")
            if "changed" in found:
                break
        if "changed" not in found and "same" in found:
            without_effect.append((*to, last))
    assert not without_effect
