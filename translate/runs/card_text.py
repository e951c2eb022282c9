"""Text of model cards that does not depend on the run."""

TITLES = {"touch2touch": "touch2touch", "resnet18": "ResNet18", "field": "Field"}

MODELS = {
    "touch2touch": """\
It is pix2pix (a U-Net generator, trained with a PatchGAN discriminator and an L1 loss) from the
grey image to the tactile image, from which the counts are read. Other taxel layouts can be read
from the same image.""",
    "resnet18": """\
It is a ResNet18 with one output per taxel, trained on the mean squared error of the counts. It
predicts the layout below only.""",
    "field": """\
It is a ResNet18 with a small decoder, which predicts the field under the whole cover: the counts of
a taxel at each of many places, with standard deviations. The layout below is read from the field,
as is any other on the cover.""",
    "reverse": """\
It is pix2pix (a U-Net generator, trained with a PatchGAN discriminator and an L1 loss) from the
tactile image of the counts to the grey image. It predicts no counts.""",
}

UNCERTAINTY = """\
## Uncertainty

The network predicts raw spreads. Factors calibrate them to standard deviations: they depend on the
spread and on the mean standard deviation of the press. After calibration, 90 % intervals covered
90 % of the field on validation presses, for small and large spreads alike. Coverage can be lower on
other families of shapes; `t2twin evaluate` measures it.
"""

TRAINED_ON_SIMULATION = """\
- It was trained on simulated images only. Real DIGITs differ in gel, lights and camera. Expect
  wrong results unless the dataset was made with a calibration of the same unit. The gain of a real
  CySkin also differs from the simulated one."""

TRAINED_ON_PAIRS = """\
- It was trained on pairs of two particular sensors. Other units differ in gel, lights, camera or
  taxels, and the resulting error is unknown."""

LIMITS = """\
- Shapes outside the DIGIT's view press taxels that the image does not show.
- Presses are perpendicular and static: no shear, no slip, no rolling.
- The error above is for validation shapes of the same families as the training shapes. Other
  objects have larger errors; `t2twin evaluate` measures them on any dataset.
- Counts are not newtons. Do not use the predictions to protect people or machines from force.
"""

REVERSE_LIMITS = """\
- Counts do not determine details finer than the pitch of the taxels, such as teeth and edges. The
  network invents them from the training shapes.
- The error above is for validation shapes of the same families as the training shapes, and over
  whole images, and most pixels do not change with contact.
- The images are not measurements.
"""

LICENSES = {
    True: ("mit", "MIT, as t2twin's."),
    False: (
        "unknown",
        "t2twin's code is under the MIT license. The weights were trained on imported pairs, whose "
        "owner decides on their license.",
    ),
}
"""License for the Hugging Face hub and in words, by whether the dataset is simulated."""

CITATION = """\
```bibtex
@inproceedings{grella2023touch,
  title     = {Touch-to-Touch Translation - Learning the Mapping Between Heterogeneous Tactile
               Sensing Technologies},
  author    = {Grella, Francesco and Albini, Alessandro and Cannata, Giorgio and
               Maiolino, Perla},
  booktitle = {IEEE/RSJ International Conference on Intelligent Robots and Systems (IROS)},
  year      = {2023},
  note      = {arXiv:2411.02187}
}
```
"""
