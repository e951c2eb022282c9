"""What `t2twin press` writes: pictures, counts, contact fields, and press.json."""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.primitives_cad.shape import Shape
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
from t2twin.sim.press import scene
from t2twin.sim.press.elastomer import Elastomer
from t2twin.sim.press.engine import press_bed
from t2twin.sim.press.records import Contact, PressCommand
from t2twin.sim.sensors import CySkin, Digit


class PressFiles:
    """The results of one press, gathered in memory and then written all at once."""

    def __init__(self, folder: Path, shape: Shape, command: PressCommand) -> None:
        self.folder, self.shape, self.command = folder, shape, command
        self.contacts: dict[str, Contact] = {}
        self.scenes: dict[str, str] = {}
        self.image: np.ndarray | None = None
        self.cyskin: CySkin | None = None
        self.counts = np.zeros(0, np.uint16)

    def add_digit(self, digit: Digit) -> None:
        contact = self._touch("digit", digit.gel, digit.pitch_mm)
        self.image = digit.see(contact, self.shape, self.command)

    def add_cyskin(self, cyskin: CySkin) -> None:
        contact = self._touch("cyskin", cyskin.cover, cyskin.pitch_mm)
        self.cyskin = cyskin
        self.counts = cyskin.feel(contact)

    def _touch(self, sensor: str, elastomer: Elastomer, pitch_mm: float) -> Contact:
        contact, bed = press_bed(self.shape, self.command, elastomer, pitch_mm)
        self.contacts[sensor] = contact
        self.scenes[sensor] = scene.scene(
            self.shape, self.command, elastomer, contact, bed, scene.mesh_name(self.shape)
        )
        return contact

    def scene_path(self) -> Path:
        """The first sensor's scene, once written."""
        return self.folder / f"scene_{next(iter(self.scenes))}.xml"

    def write(self) -> None:
        """Write all files, or none, and say what was found."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".press-", dir=self.folder) as temporary:
            self._write_into(Path(temporary))
            for path in sorted(Path(temporary).iterdir()):
                path.replace(self.folder / path.name)
        for sensor, contact in self.contacts.items():
            print(_in_words(sensor, contact))
        if self.cyskin is not None:
            print("counts: " + " ".join(str(count) for count in self.counts))
        print(f"written to {self.folder}")

    def _write_into(self, folder: Path) -> None:
        (folder / "press.json").write_text(json.dumps(self._summary(), indent=1) + "\n")
        for sensor, contact in self.contacts.items():
            np.savez_compressed(
                folder / f"contact_{sensor}.npz",
                surface_mm=contact.surface_mm,
                pressure_kpa=contact.pressure_kpa,
                x_mm=contact.x_mm,
                y_mm=contact.y_mm,
            )
        for sensor, text in self.scenes.items():
            (folder / f"scene_{sensor}.xml").write_text(text)
        mesh_file = scene.mesh_name(self.shape)
        if mesh_file is not None:
            self.shape.mesh.export(folder / mesh_file)
        if self.image is not None:
            Image.fromarray(self.image).save(folder / "digit.png")
        if self.cyskin is not None:
            self._write_cyskin(folder, self.cyskin)

    def _write_cyskin(self, folder: Path, cyskin: CySkin) -> None:
        from t2twin.translate.phi import Phi
        from t2twin.translate.picture import tactile_picture

        layout = cyskin.layout
        content = {
            "layout": layout.name,
            "counts": self.counts.tolist(),
            "x_mm": layout.x_mm.tolist(),
            "y_mm": layout.y_mm.tolist(),
            "full_scale_counts": FULL_SCALE_COUNTS,
        }
        (folder / "cyskin.json").write_text(json.dumps(content, indent=1) + "\n")
        image = Phi(layout.x_mm, layout.y_mm)(self.counts.astype(np.float32))
        # Counts as they are, 16 bits a pixel: the picture is data too.
        Image.fromarray(np.rint(image).astype(np.uint16)).save(folder / "tactile_image.png")
        picture = tactile_picture(image, layout.x_mm, layout.y_mm, FULL_SCALE_COUNTS)
        picture.save(folder / "tactile_picture.png")

    def _summary(self) -> dict[str, Any]:
        command = self.command
        return {
            "shape": command.shape,
            "x_mm": command.x_mm,
            "y_mm": command.y_mm,
            "yaw_rad": command.yaw_rad,
            "commanded_force_n": command.force_n,
        } | {
            sensor: {
                "force_n": contact.force_n,
                "depth_mm": contact.depth_mm,
                "settled": contact.settled,
                "bottomed": contact.bottomed,
                "contact_area_mm2": contact.contact_area_mm2,
                "milliseconds": contact.milliseconds,
            }
            for sensor, contact in self.contacts.items()
        }


def _in_words(sensor: str, contact: Contact) -> str:
    words = (
        f"{sensor}: {contact.force_n:.2f} N at {contact.depth_mm:.3f} mm, "
        f"{contact.contact_area_mm2:.1f} mm2 in contact, {contact.milliseconds:.0f} ms"
    )
    if not contact.settled:
        words += "; it did not come to rest"
    if contact.bottomed:
        words += "; it bottomed out: the base plate (the lowest flat face) touched"
    return words
