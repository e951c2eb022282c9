"""Images, valid and damaged, and the cases of `t2twin translate`."""

import io
import os
import struct
import zlib
from collections.abc import Iterator
from functools import cache

import numpy as np
from cases import Case, Files, damaged, laid, link
from PIL import Image

SIDE = (240, 320)
"""Width and height of a DIGIT image, px."""

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def frame(seed: int = 0, size: tuple[int, int] = SIDE) -> Image.Image:
    """An RGB image with a blurred spot and noise."""
    x, y = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    ball = np.exp(-8 * ((x - 0.1 * (seed % 5)) ** 2 + (y + 0.1 * (seed % 7)) ** 2))
    noise = np.random.default_rng(seed).normal(0, 3, (size[1], size[0], 3))
    pixels = 90 + 60 * ball[..., None] * np.array([1.0, -0.5, 0.7]) + noise
    return Image.fromarray(pixels.clip(0, 255).astype(np.uint8))


def encoded(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def chunk(name: bytes, content: bytes) -> bytes:
    """A chunk of a PNG file."""
    check = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)


def header(width: int, height: int, depth: int = 8, color: int = 2) -> bytes:
    """Signature and header chunk of a PNG file."""
    about = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    return SIGNATURE + chunk(b"IHDR", about)


def black_png(width: int, height: int, rows: int) -> bytes:
    """A black PNG whose header may announce more than its rows."""
    data = zlib.compress(b"\0" * (1 + 3 * min(width, 20_000)) * rows, 9)
    return header(width, height) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@cache
def bomb() -> bytes:
    """A PNG of 4 MB with 1.4 GB of pixels."""
    noise = np.random.default_rng(0).bytes(4_000_000)
    data = zlib.compress(b"\0" * 66_001 * 1000, 1) + noise
    return header(22_000, 22_000) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


PNG, JPEG = encoded(frame()), encoded(frame(), "JPEG")


def grey16(size: tuple[int, int] = SIDE) -> bytes:
    wide = np.asarray(frame(size=size).convert("L")).astype(np.uint16) * 257
    return encoded(Image.fromarray(wide))


def bad() -> Iterator[tuple[str, bytes]]:
    """Name and content of files that are no complete image; see also cases.DAMAGES."""
    yield from {
        "a header alone": header(240, 320), "EPS": b"%!PS-Adobe-3.0 EPSF-3.0\n",
        "a link": b'<svg><image href="http://x.test/a"/></svg>',
        "no width": header(0, 320) + PNG[33:], "3 bits": header(240, 320, 3) + PNG[33:],
        "color 5": header(240, 320, 8, 5) + PNG[33:], "a bomb": bomb(),
        "a wrong checksum of the header": PNG[:29] + b"\0\0\0\0" + PNG[33:],
        "a flipped byte": PNG[: len(PNG) // 2] + b"\xa5\x5a" + PNG[len(PNG) // 2 + 2 :],
        "no pixels": header(240, 320) + chunk(b"IEND", b""), "cut at its end": PNG[:-1],
        "announced 100,000 x 100,000": black_png(100_000, 100_000, 10),
        "4,001 x 3,000": black_png(4001, 3000, 3000), "a JPEG, cut": JPEG[: len(JPEG) // 2],
    }.items()  # fmt: skip
    for kind in ("BMP", "GIF", "TIFF", "PPM", "ICO"):
        yield f"{kind} as PNG", encoded(frame(), kind)
    text = zlib.compress(bytes(200_000_000), 9)
    for name, start in ((b"zTXt", b"Comment\0\0"), (b"iCCP", b"x\0\0")):
        yield f"{name.decode()} of 200 MB", PNG[:33] + chunk(name, start + text) + PNG[33:]


def odd() -> Iterator[tuple[str, bytes]]:
    """Name and content of odd but valid images."""
    for mode in ("L", "LA", "RGBA", "P", "1"):
        yield f"mode {mode}", encoded(frame().convert(mode))
    exif = Image.Exif()
    exif[0x0112] = 77
    yield from {
        "1 x 500": encoded(frame(size=(1, 500))), "16 bits": grey16(), "junk": PNG + bytes(1000),
        "3,000 x 4,000, the most": black_png(3000, 4000, 4000), "JPEG as PNG": JPEG,
        "CMYK": encoded(frame().convert("CMYK"), "JPEG"),
        "a wrong orientation": encoded(frame(), "JPEG", exif=exif),
        "animated": encoded(frame(), save_all=True, append_images=[frame(1)]),
        "white": encoded(Image.new("RGB", SIDE, "white")),
    }.items()  # fmt: skip


NAMES = (b"na\nme.png", b"caf\xe9.png", "naïve 🖐.png".encode(), b"--out.png", b"a" * 240 + b".png",
         b"'; rm -rf x.png", b"%s{}.png", b"counts.csv.png", b"A.PNG", b" .png")  # fmt: skip

TRANSLATE = "translate --run {resnet18} --out out "

FOLDERS: tuple[tuple[str, Files, str, str], ...] = (
    ("a folder called x.png", {"x.png/notes.txt": b""}, "x.png", "images"),
    ("a link to itself", {"x.png": link("x.png")}, "x.png", "x.png"),
    ("one of two damaged", {"d/a.png": PNG, "d/b.png": PNG[:300]}, "d", "b.png"),
    ("eight bombs", {f"d/{n}.png": bomb() for n in range(8)}, "d", "pixels"),
    ("its own result", {"out/x.png": PNG}, "out/x.png", "would be replaced"),
)
"""Name, files, argument and part of the sentence."""


def cases() -> Iterator[Case]:
    yield from damaged("image", (f"{TRANSLATE} x.png",), {}, "x.png", bad(), "x.png")
    yield from damaged("image", (f"{TRANSLATE} x.png",), {}, "x.png", odd(), fine=True)
    for name, files, argument, says in FOLDERS:
        yield Case(f"image: {name}", TRANSLATE + argument, laid(files), says)
    for name in NAMES:
        files = {f"d/{os.fsdecode(name)}": PNG}
        yield Case(f"image called {name[:20]!r}", TRANSLATE + "d", laid(files), fine=True)
    twice = laid({"d/x.png": PNG, "d/x.jpg": JPEG})
    for argument in ("d", "d/x.png d/x.png"):
        yield Case(f"image twice: {argument}", TRANSLATE + argument, twice, fine=True)
