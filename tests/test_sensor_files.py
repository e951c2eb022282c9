"""Sensor files: bundled ones, a user's own, and the sentences for files that are wrong."""

import copy
import hashlib
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from kinds import gel_camera, taxel_array
from msgspec import structs

from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.artifacts import Artifacts, with_artifacts
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors import files
from t2twin.sim.sensors.files import SPECS, bundled_sensors, load_sensor, sensor_of, spec_of
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.taxel_array import TaxelArray

SENSORS = bundled_sensors()
FORCE_N = 8.0


def content_of(name: str) -> dict[str, Any]:
    return copy.deepcopy(files._content(SPECS / f"{name}.toml", ())[0])


def refused(content: dict[str, Any]) -> str:
    """The message for a file with this content."""
    with pytest.raises(T2TwinError) as stop:
        sensor_of(spec_of(content, "my.toml"), str(SPECS), "my.toml")
    message = str(stop.value)
    assert message.startswith("my.toml: ") and "\n" not in message
    return message


def counts_of(array: TaxelArray, contact: Any) -> np.ndarray:
    counts = array.read(contact).counts
    assert counts is not None
    return counts


# Bundled files


@pytest.mark.parametrize("name", SENSORS)
def test_every_value_has_a_source_or_is_assumed(name):
    """In a comment behind it, or in one above its table."""
    covered = above = False
    for line in (SPECS / f"{name}.toml").read_text().splitlines():
        code, _, comment = line.partition("#")
        if not code.strip():
            above = bool(comment.strip())
        elif code.startswith("["):
            covered = above
        elif code.startswith(("kind", "name", "extends")):
            assert above or covered is False
        else:
            assert comment.strip() or covered, line


def test_bundled_sensors_have_the_names_of_their_files():
    assert {"cyskin-20", "cyskin-63", "digit", "flexitac", "gelsight-mini"} <= set(SENSORS)
    for name in SENSORS:
        assert load_sensor(name).name == name and load_sensor(name) is load_sensor(name)
    assert load_sensor("cyskin").name == "cyskin-20"


def test_gelsight_mini_has_its_published_geometry():
    sensor = gel_camera("gelsight-mini")
    half_x, half_y = sensor.camera.seen_half_extent_mm()
    assert (2 * half_x, 2 * half_y) == (pytest.approx(18.9, abs=0.1), pytest.approx(14.2, abs=0.1))
    sag_mm = -sensor.elastomer.rest_surface_mm(np.array([9.716, 0.0]), np.array([0.0, 7.535]))
    np.testing.assert_allclose(sag_mm, 0.25, atol=0.001)
    printed = sensor.with_options({"markers": True}).markers
    assert printed is not None and len(printed.rest_mm) == 9 * 7
    assert np.abs(printed.rest_mm).max(axis=0).tolist() == [8, 6]


def test_a_gelsight_mini_is_red_above_blue_below_and_green_at_the_right(shapes):
    sensor = gel_camera("gelsight-mini")
    contact = sensor.press(shapes("hemisphere-4"), PressCommand("ball", 0.0, 0.0, 0.0, 5.0))
    change = sensor.image(contact).astype(int) - sensor.background_frame()
    radius_px = int(0.6 * np.sqrt(contact.contact_area_mm2 / np.pi) * 16.9)
    for red_green_blue, rows, columns in (
        (0, -radius_px, 0), (1, 0, radius_px), (2, radius_px, 0),
    ):  # fmt: skip
        flank = change[120 + rows - 3 : 120 + rows + 4, 160 + columns - 3 : 160 + columns + 4]
        assert flank[..., red_green_blue].mean() > 5
        assert flank.mean(axis=(0, 1)).argmax() == red_green_blue


def test_flexitac_reads_in_the_order_of_its_driver(shapes):
    """12 rows along y of 32 values along x, and a place of the dense counts at every point."""
    sensor = taxel_array("flexitac")
    frame_x, frame_y = (v.reshape(12, 32) for v in (sensor.layout.x_mm, sensor.layout.y_mm))
    np.testing.assert_allclose(np.diff(frame_x, axis=1), 2.0)
    np.testing.assert_allclose(np.diff(frame_y, axis=0), 2.0)
    places = {(round(x, 6), round(y, 6)) for x, y in zip(
        sensor.dense.x_mm, sensor.dense.y_mm, strict=True
    )}  # fmt: skip
    own = zip(sensor.layout.x_mm, sensor.layout.y_mm, strict=True)
    assert places == {(round(x, 6), round(y, 6)) for x, y in own}
    contact = sensor.press(shapes("hemisphere-4"), PressCommand("ball", 10.0, -4.0, 0.0, FORCE_N))
    frame = counts_of(sensor, contact).reshape(12, 32)
    row, column = np.unravel_index(frame.argmax(), frame.shape)
    assert abs(2.0 * column - 31.0 - 10.0) <= 1.0 and abs(2.0 * row - 11.0 + 4.0) <= 1.0
    assert sensor.full_scale == 255 and sensor.read(contact).tactile_image.shape == (72, 192)


@pytest.mark.parametrize("name", SENSORS)
def test_8_newtons_in_are_8_newtons_out(name, shapes):
    sensor = load_sensor(name)
    contact = sensor.press(shapes("square-1"), PressCommand("square", 0.5, -0.5, 0.3, FORCE_N))
    assert contact.settled
    newtons = 1e-3 * contact.pressure_kpa.sum() * contact.pitch_mm**2
    assert newtons == pytest.approx(FORCE_N, rel=0.01)
    reading: Any = sensor.read(contact, np.random.default_rng(0))
    if isinstance(sensor, GelCamera):
        background = sensor.background_frame()
        assert reading.image.shape == (sensor.camera.rows, sensor.camera.columns, 3)
        assert np.abs(reading.image.astype(int) - background).max() > 30
        assert (background <= 2).mean() < 0.02 and (background >= 253).mean() < 0.02
    else:
        assert 0.02 * sensor.full_scale < reading.counts.max() < sensor.full_scale
        normal_n = 1e-3 * reading.tractions[0].sum() * sensor.dense_table.cell_mm2
        assert normal_n == pytest.approx(FORCE_N, rel=0.01)


# The default pair


def digest(*arrays: Any) -> str:
    both = b"".join(np.ascontiguousarray(each).tobytes() for each in arrays)
    return hashlib.sha256(both).hexdigest()[:16]


def test_the_default_pair_keeps_its_bytes(shapes):
    """Those of x86-64 processors with AVX-512 or with AVX2 alone, whose last digits differ.

    A change of the contact solver changes them.
    """
    sensors = SensorPair()
    found = {}
    for name, command in {
        "square-1": PressCommand("square-1", 0.0, 0.0, 0.0, 8.0),
        "hemisphere-4": PressCommand("hemisphere-4", 2.0, -3.0, float(np.radians(20)), 8.0),
        "pliers/jaw-tip": PressCommand("pliers/jaw-tip", 0.0, 0.0, float(np.radians(60)), 4.0),
    }.items():
        rng = np.random.default_rng(3) if name == "hemisphere-4" else None
        touch = sensors.press(shapes(name), command, rng)
        found[name] = (digest(touch.image), digest(touch.counts), digest(touch.dense_counts))
    with_avx512 = {
        "square-1": ("353af00975b4d556", "94083469db5bb154", "1b3e4f10938fa150"),
        "hemisphere-4": ("2eee3214034620a8", "e2e4e4dbe3bff9d6", "7761d1183acd7d2b"),
        "pliers/jaw-tip": ("675cd0dd56260b48", "37f4c8053d17dab8", "c4744a3a6c9a676c"),
    }
    with_avx2 = {
        "square-1": ("4911d9ef59f58a12", "94083469db5bb154", "1b3e4f10938fa150"),
        "hemisphere-4": ("655e3074ae9b548e", "e2e4e4dbe3bff9d6", "7761d1183acd7d2b"),
        "pliers/jaw-tip": ("675cd0dd56260b48", "37f4c8053d17dab8", "9639b0d11bdf0811"),
    }
    assert found in (with_avx512, with_avx2)


def test_a_sampled_unit_keeps_its_bytes():
    sensor, rng = gel_camera(), np.random.default_rng(0)
    unit = sample_unit(rng, sensor.spec, UnitRanges())
    assert digest(unit.optics.background) == "b0db7fa84ec322df"
    assert digest(unit.optics.response) == "707ee6898f2a010d"
    unit = with_artifacts(rng, unit, Artifacts(), sensor.spec.light.leds)
    assert digest(unit.optics.background) == "a256981fb25b80d9"
    assert digest(unit.earlier_background) == "ed816a268d5ba230"


def test_the_places_of_the_dense_counts_stay():
    places = taxel_array().dense
    assert places.size == 216
    assert (digest(places.x_mm), digest(places.y_mm)) == ("23aa197308d1df21", "4bf0d32d915db8af")


# Faults, one sentence each


Place = tuple[str | int, ...]


def changed(content: dict[str, Any], place: Place, *value: Any) -> dict[str, Any]:
    """The content with another value at a place, or without one."""
    content = copy.deepcopy(content)
    table: Any = content
    for part in place[:-1]:
        table = table[part]
    if value:
        table[place[-1]] = value[0]
    else:
        table.pop(place[-1], None)
    return content


ON_ITSELF = content_of("digit")["light"]["leds"][0] | {
    "angle_deg": 0.0, "radius_mm": 5.0, "z_mm": -3.0, "aim_mm": [5.0, 0.0, -3.0],
}  # fmt: skip


DIM = content_of("digit")["light"]["leds"][0] | {"color": [1e-7, 1e-7, 1e-7]}


@pytest.mark.parametrize(
    ("name", "place", "value", "sentence"),
    [
        ("digit", ("gel", "thickness_mm"), "thick", "$.gel.thickness_mm"),
        ("digit", ("camera", "rowss"), 3, "`rowss`"),
        ("digit", ("kind",), 3, "kind is 3"),
        ("digit", ("camera", "scale_px_per_mm"), 9.0, "the camera sees 26.7 mm of the gel's width"),
        ("flexitac", ("cover", "grid_mm"), 0.1, "which gives the layer 660 x 260 cells"),
        ("gelsight-mini", ("gel", "thickness_mm"), 24.0, "is 24 mm from the apex, inside"),
        ("gelsight-mini", ("gel", "dome_width_radius_mm"), 13.0, "leaves less than 0.5 mm of"),
        ("gelsight-mini", ("gel", "dome_length_radius_mm"), 12.0, "0.422 mm along x and 5.97"),
        ("digit", ("units", "distance_mm"), [22.0, 20.8], "expected low first"),
        ("digit", ("light", "leds", 1, "beam_deg"), [9.0, 9.0], "beam_deg is [9, 9]"),
        ("digit", ("light", "leds", 0), ON_ITSELF, "aim_mm is the LED's own place"),
        ("digit", ("light",), {"ambient": [0.1, 0.1, 0.1]}, "at least one of leds and optics"),
        ("digit", ("light", "optics"), "none.npz", "none.npz does not exist"),
        ("digit", ("camera", "columns"), 300, "camera.columns is not that of digit"),
        ("digit", ("gel", "dome_flat_mm"), 4.0, "gel.dome_flat_mm is not that of digit"),
        ("cyskin-20", ("counts", "rate_hz"), None, "recorded has a memory, which needs"),
        ("gelsight-mini", ("markers", "diameter_mm"), 3.0, "diameter_mm"),
        ("gelsight-mini", ("light", "ambient"), [9.0, 0.0, 0.0], "100 % of the background frame"),
        ("gelsight-mini", ("light",), {"leds": [DIM]}, "% of the background frame are black"),
        ("flexitac", ("layout", "pitch_mm"), 3.0, "taxel(s) off the cover"),
        ("flexitac", ("layout", "file"), "a.csv", "expected file, or all of rows, columns"),
        ("flexitac", ("transducer", "modulus_mpa"), 1.0, "is not of the law piezo"),
        ("flexitac", ("transducer", "law"), "capacitive", "modulus_mpa is needed by"),
        ("flexitac", ("tactile_image", "rows"), 40, "tactile_image.rows is 40"),
        ("flexitac", ("tactile_image", "px_per_mm"), 0.4, "two taxels share a pixel below 0.5"),
        ("flexitac", ("dense", "spacing_mm"), 0.2, "use a larger spacing_mm"),
        ("flexitac", ("imperfections", "white", "dead"), [384], "imperfections.white: dead"),
        ("flexitac", ("imperfections", "none"), {}, "imperfections.none is the array without"),
        ("flexitac", ("imperfections", "white", "drift_share"), 0.1, "drift_counts is missing"),
        ("cyskin-20", ("imperfections", "recorded", "load_noise_counts"), 0.0, "load_noise_spread"),
        ("flexitac", ("imperfections", "white", "memory_rise_s"), 0.1, "since memory_s is missing"),
        ("flexitac", ("cover", "dome_flat_mm"), 3.0, "dome_flat_mm is 3 and dome_length_"),
        ("gelsight-mini", ("gel", "dome_flat_mm"), 10.4, "less than half of length_mm, 10.375"),
        ("flexitac", ("imperfections", "empty"), {}, "imperfections.empty has no effect"),
        ("gelsight-mini", ("markers", "seed"), 3, "no effect without jitter_mm"),
        ("flexitac", ("name",), "press", "name is 'press'"),
        ("gelsight-mini", ("name",), "source", "choose another"),
    ],
)  # fmt: skip
def test_values_that_contradict_each_other_are_one_sentence(name, place, value, sentence):
    assert sentence in refused(changed(content_of(name), place, value))


# A user's own files


def test_a_file_extends_another_and_a_chain_of_them(tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "soft.toml").write_text(
        'extends = "digit"\nname = "soft"\n[gel]\nyoung_mpa = 0.2\n'
    )
    (tmp_path / "mine.toml").write_text(
        'extends = "other/soft.toml"\nname = "mine"\n[camera]\nnoise_grey = 0.5\n'
    )
    mine, digit = load_sensor(tmp_path / "mine.toml"), gel_camera()
    assert isinstance(mine, GelCamera)
    assert (mine.name, mine.elastomer.young_mpa, mine.noise_grey < 0.1) == ("mine", 0.2, True)
    np.testing.assert_array_equal(mine.background_frame(), digit.background_frame())
    own = digit.spec
    assert mine.spec == structs.replace(
        own,
        name="mine",
        gel=structs.replace(own.gel, young_mpa=0.2),
        camera=structs.replace(own.camera, noise_grey=0.5),
    )


@pytest.mark.parametrize(
    ("base", "text", "without"),
    [
        ("cyskin-20", "[transducer]\nlargest_strain = 0.4", ()),
        ("flexitac", "[layout]\npitch_mm = 1.5", ()),
        ("gelsight-mini", "[markers]\ndiameter_mm = 0.7", ()),
        ("cyskin-20", "[layout]\nrows = 4\ncolumns = 4\npitch_mm = 5\npad = 'round'\npad_mm = 4",
         ("file",)),
        ("digit", '[gel]\ndome_length_radius_mm = inf\n[light]\noptics = "none"',
         ("dome_flat_mm",)),
    ],
)  # fmt: skip
def test_values_are_those_of_the_extended_file_unless_others_exclude_them(base, text, without):
    own = tomllib.loads(text)
    found, before = files._merged(content_of(base), own), content_of(base)
    spec_of(found, "my.toml")
    for name, values in own.items():
        expected = {k: v for k, v in before[name].items() if k not in without} | values
        assert found[name] == expected


def test_ranges_of_units_move_with_the_values_of_the_camera(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('extends = "gelsight-mini"\nname = "mine"\n[camera]\nscale_px_per_mm = 33.8\n')
    mini, mine = (gel_camera(each).spec.units for each in ("gelsight-mini", path))
    assert mini is not None and mine is not None
    assert mine.scale_px_per_mm == pytest.approx([2 * each for each in mini.scale_px_per_mm])
    assert mine.distance_mm == mini.distance_mm
    path.write_text(path.read_text() + "[units]\nscale_px_per_mm = [30.0, 33.0]\n")
    with pytest.raises(T2TwinError, match="expected a range that contains camera"):
        load_sensor(path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[camera]\nshift_x_px = 100\n", "camera.shift_x_px is not that of digit"),
        ("[light]\nambient = [0, 0, 0]\n", "light.ambient is not that of digit"),
        ('[light]\noptics = "none"\nleds = []\n', "at least one of leds and optics"),
        ('[light]\noptics = "None"\n', "mine.toml: light.optics is 'None'; expected an optics"),
        ('[camera]\nscale_px_per_mm = 5\n[light]\noptics = "none"\n', "the camera sees 48.0 mm"),
        ('[camera]\ncolumns = 200\n[light]\noptics = "none"\n', None),
        ('[camera]\ncolumns = 320\n[light]\noptics = "unit.npz"\n', None),
        ('[light]\noptics = "unit.npz"\ngamma = 2.0\n', "light.gamma is 2, but"),
        ('[light]\noptics = "unit.npz"\nambient = [1, 0, 0]\n', "have no effect beside"),
        ('[camera]\ndistance_mm = 30\n[light]\noptics = "unit.npz"\n', "is 30, but .*with 25"),
        ('[gel]\nyoung_mpa = 0.3\n[light]\noptics = "unit.npz"\n', "is 0.3, but .* with 0.2"),
    ],
)
def test_optics_are_of_the_values_that_a_file_states(text, sentence, tmp_path):
    given = gel_camera("gelsight-mini").optics
    camera = structs.replace(given.camera, distance_mm=25.0)
    replace(given, camera=camera, young_mpa=0.2).save(tmp_path / "unit.npz")
    path = tmp_path / "mine.toml"
    base = "gelsight-mini" if "unit.npz" in text else "digit"
    path.write_text(f'extends = "{base}"\nname = "mine"\n{text}')
    if sentence is not None:
        with pytest.raises(T2TwinError, match=sentence):
            load_sensor(path)
        return
    mine = gel_camera(path)
    assert mine.optics.camera == mine.camera and mine.elastomer == mine.own_gel
    assert (mine.camera.columns == 200) == (mine.optics.young_mpa is None)


def test_a_given_gel_is_pressed_as_it_is(tmp_path):
    """Also where its modulus is the file's and the optics have another one."""
    camera = gel_camera()
    replace(camera.optics, young_mpa=0.2).save(tmp_path / "unit.npz")
    fitted = camera.with_options({"optics": tmp_path / "unit.npz"})
    assert fitted.elastomer == replace(camera.own_gel, young_mpa=0.2)
    assert fitted.with_options({"gel": camera.own_gel}).elastomer == camera.own_gel
    with pytest.warns(T2TwinWarning, match="the optics are of another dome"):
        fitted.with_options({"gel": replace(camera.own_gel, dome_flat_mm=5.0)})


@pytest.mark.parametrize(
    "changes",
    [{"thickness_mm": 1.0}, {"dome_width_radius_mm": 5.0}, {"dome_length_radius_mm": np.inf}],
)
def test_a_dome_stays_above_the_base_and_has_an_effect(changes):
    with pytest.raises(T2TwinError, match=r"leaves less than 0.5 mm|one of which has no effect"):
        replace(gel_camera().own_gel, **changes)


def test_a_rate_without_a_memory_is_not_used():
    content = changed(content_of("flexitac"), ("counts", "rate_hz"), 60)
    with pytest.warns(T2TwinWarning, match=r"my.toml: counts.rate_hz has no effect"):
        spec_of(content, "my.toml")


@pytest.mark.parametrize("extends", ["a.toml", "b/b.toml"])
def test_a_file_that_extends_itself_is_refused(extends, tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "a.toml").write_text(f'extends = "{extends}"\nname = "a"\n')
    (tmp_path / "b" / "b.toml").write_text('extends = "../a.toml"\nname = "b"\n')
    with pytest.raises(T2TwinError, match="extends itself; remove one"):
        load_sensor(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('extends = "digitt"\n', "extends is 'digitt'.*did you mean digit"),
        ("extends = 3\n", "extends"),
        ("a = [\n", r"mine\.toml: "),
        ("light.leds = [{size_mm = 1.0, color = [1, nan]}]", "nan is not a number"),
        ("", "kind is missing; expected gel-camera or taxel-array"),
        ('extends = "digit"\nkind = "taxel-array"\n', "kind is not that of digit, gel-camera"),
    ],
)
def test_files_that_are_no_sensors_are_one_sentence(text, sentence, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(T2TwinError, match=sentence) as stop:
        load_sensor(path)
    assert "\n" not in str(stop.value)


def test_a_users_files_lie_beside_each_other(tmp_path, shapes):
    """Optics and a layout of its own in another folder than the working one."""
    folder = tmp_path / "sensors"
    folder.mkdir()
    optics = gel_camera("gelsight-mini").optics
    optics.save(folder / "my_unit.npz")
    (folder / "camera.toml").write_text(
        'extends = "gelsight-mini"\nname = "my-camera"\n[light]\noptics = "my_unit.npz"\n'
    )
    (folder / "pads.csv").write_text("x_mm,y_mm\n-5,-5\n5,-5\n0,5\n")
    (folder / "array.toml").write_text(
        'extends = "cyskin-20"\nname = "my-array"\n[layout]\nfile = "pads.csv"\n'
    )
    sensors = SensorPair.of(folder / "camera.toml", folder / "array.toml")
    touch = sensors.press(shapes("square-1"), PressCommand("square-1", 0.0, 0.0, 0.0, 8.0))
    assert list(touch) == ["my-camera", "my-array"] and "digit" not in touch
    assert touch.counts.shape == (3,)
    np.testing.assert_array_equal(sensors.camera.background_frame(), optics.background)
    assert sensors.camera.optics_path == folder / "my_unit.npz"


def test_an_array_needs_no_imperfections(tmp_path):
    content = content_of("flexitac")
    del content["imperfections"], content["dense"]
    array = sensor_of(spec_of(content, ""), "", "")
    assert isinstance(array, TaxelArray)
    assert array.imperfections == "none" and array.dense.size > 100
    assert not counts_of(array, None).any()


@pytest.mark.parametrize("size", [(247, 318), (16, 23)])
def test_images_of_any_size(size, shapes):
    """With markers, sampled units and artifacts: sizes that no step of theirs divides."""
    content = content_of("gelsight-mini")
    rows, columns = size
    scale = max(16.9, columns / 20.0)
    content["camera"] |= {"rows": rows, "columns": columns, "scale_px_per_mm": scale}
    sensor = sensor_of(spec_of(content, ""), str(SPECS), "")
    assert isinstance(sensor, GelCamera)
    marked = sensor.with_options({"markers": True})
    contact = sensor.press(shapes("hemisphere-4"), PressCommand("ball", 0.0, 0.0, 0.0, 5.0))
    leds = sensor.spec.light.leds
    rng = np.random.default_rng(0)
    unit = sample_unit(rng, sensor.spec, UnitRanges())
    for each in (unit, with_artifacts(rng, unit, Artifacts(worn=1.0), leds)):
        for of in (sensor.with_unit(each), marked.with_unit(each)):
            image, background = of.image(contact, rng), of.background_frame(rng)
            assert image.shape == background.shape == (rows, columns, 3)
            assert np.abs(image.astype(int) - background).max() > 5
