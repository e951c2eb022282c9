"""Pictures for `translate`: damaged, huge, of other kinds, in odd places."""

import io
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.inputs.case import Base, Case, Make, holding

SIDE = (240, 320)
"""Width and height of a DIGIT's picture."""


def frame(seed: int = 0, size: tuple[int, int] = SIDE) -> Image.Image:
    """A picture with something in it, RGB."""
    x, y = np.meshgrid(np.linspace(-1, 1, size[0]), np.linspace(-1, 1, size[1]))
    ball = np.exp(-8 * ((x - 0.1 * (seed % 5)) ** 2 + (y + 0.1 * (seed % 7)) ** 2))
    noise = np.random.default_rng(seed).normal(0, 3, (size[1], size[0], 3))
    pixels = 90 + 60 * ball[..., None] * np.array([1.0, -0.5, 0.7]) + noise
    return Image.fromarray(pixels.clip(0, 255).astype(np.uint8))


def encoded(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def chunk(name: bytes, content: bytes, checksum: int | None = None) -> bytes:
    """A chunk of a PNG file."""
    crc = zlib.crc32(name + content) if checksum is None else checksum
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", crc)


SIGNATURE = b"\x89PNG\r\n\x1a\n"


def header(width: int, height: int, depth: int = 8, color: int = 2, *rest: int) -> bytes:
    """A PNG's header chunk; rest: compression, filter, interlace."""
    return chunk(
        b"IHDR", struct.pack(">IIBBBBB", width, height, depth, color, *(rest or (0, 0, 0)))
    )


def png_of(width: int, height: int, rows: int | None = None) -> bytes:
    """A black PNG that may announce another size than it holds."""
    line = b"\0" * (1 + 3 * min(width, 20_000))
    data = zlib.compress(line * min(rows if rows is not None else height, 20_000), 9)
    return SIGNATURE + header(width, height) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def bomb() -> bytes:
    """Some 4 MB that would be 1.4 GB of pixels."""
    noise = np.random.default_rng(0).bytes(4_000_000)
    return (
        SIGNATURE
        + header(22_000, 22_000)
        + chunk(b"IDAT", zlib.compress(b"\0" * 66_001 * 1000, 1) + noise)
        + chunk(b"IEND", b"")
    )


PNG = encoded(frame())
JPEG = encoded(frame(), "JPEG")


def _spoiled() -> Iterator[tuple[str, bytes, str]]:
    """Name, content and suffix of files that are no whole picture."""
    yield "empty", b"", ".png"
    yield "one byte", b"\x89", ".png"
    yield "the signature alone", SIGNATURE, ".png"
    yield "a header alone", SIGNATURE + header(240, 320), ".png"
    yield "text", b"this is a picture\n", ".png"
    yield "HTML", b"<!DOCTYPE html><html><body>404</body></html>", ".png"
    yield "JSON", b'{"width": 240}', ".jpg"
    yield "zeros", bytes(10_000), ".png"
    yield "noise", np.random.default_rng(1).bytes(50_000), ".png"
    yield "a zip", b"PK\x03\x04" + bytes(100), ".png"
    yield "a pickle", b"\x80\x04\x8c\x05posix\x94\x8c\x06system\x94\x93\x94.", ".png"
    for share in (0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
        yield f"PNG cut at {share:.0%}", PNG[: int(share * len(PNG))], ".png"
        yield f"JPEG cut at {share:.0%}", JPEG[: int(share * len(JPEG))], ".jpg"
    for kind in ("BMP", "GIF", "TIFF", "WEBP", "PPM", "TGA", "ICO"):
        yield f"{kind} called PNG", encoded(frame(), kind), ".png"
    yield (
        "SVG",
        b'<svg xmlns="http://www.w3.org/2000/svg"><image href="http://x.test/a"/></svg>',
        ".png",
    )
    yield "EPS", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nshowpage\n", ".png"
    yield "no width", SIGNATURE + header(0, 320) + PNG[33:], ".png"
    yield "no height", SIGNATURE + header(240, 0) + PNG[33:], ".png"
    yield "a depth of 3 bits", SIGNATURE + header(240, 320, 3) + PNG[33:], ".png"
    yield "a color that is none", SIGNATURE + header(240, 320, 8, 5) + PNG[33:], ".png"
    yield "a wrong checksum of the header", PNG[:29] + b"\0\0\0\0" + PNG[33:], ".png"
    data = bytearray(PNG)
    data[len(data) // 2] ^= 0xFF
    yield "one byte flipped", bytes(data), ".png"
    yield "no pixels", SIGNATURE + header(240, 320) + chunk(b"IEND", b""), ".png"
    yield "a bomb of 22,000 squared", bomb(), ".png"
    yield "announced 100,000 x 100,000", png_of(100_000, 100_000, rows=10), ".png"
    yield "announced 2^31 wide", png_of(2**31 - 1, 1), ".png"
    yield "4,001 x 3,000, one column too many", png_of(4001, 3000), ".png"
    text = zlib.compress(bytes(200_000_000), 9)
    bomb_text = chunk(b"zTXt", b"Comment\0\0" + text)
    yield "a comment of 200 MB", PNG[:33] + bomb_text + PNG[33:], ".png"
    yield (
        "a color profile of 200 MB",
        PNG[:33] + chunk(b"iCCP", b"x\0\0" + text) + PNG[33:],
        ".png",
    )
    yield "JPEG of 65,500 x 65,500", _jpeg_of(65_500, 65_500), ".jpg"


def _jpeg_of(width: int, height: int) -> bytes:
    """JPEG whose header announces another size."""
    start = JPEG.index(b"\xff\xc0") + 5
    return JPEG[:start] + struct.pack(">HH", height, width) + JPEG[start + 4 :]


def _odd() -> Iterator[tuple[str, bytes, str]]:
    """Odd pictures that are fine."""
    image = frame()
    yield "1 x 1", encoded(frame(size=(1, 1))), ".png"
    yield "1 x 500", encoded(frame(size=(1, 500))), ".png"
    yield "3,000 x 4,000, the most", png_of(3000, 4000), ".png"
    yield "grey", encoded(image.convert("L")), ".png"
    yield "grey with transparency", encoded(image.convert("LA")), ".png"
    yield "colour with transparency", encoded(image.convert("RGBA")), ".png"
    yield "256 colors", encoded(image.convert("P")), ".png"
    yield "black and white", encoded(image.convert("1")), ".png"
    wide = np.asarray(image.convert("L")).astype(np.uint16) * 257
    yield "16 bits", encoded(Image.fromarray(wide)), ".png"
    yield "CMYK", encoded(image.convert("CMYK"), "JPEG"), ".jpg"
    yield "progressive", encoded(image, "JPEG", progressive=True), ".jpg"
    yield "JPEG called PNG", JPEG, ".png"
    yield "capital suffix", JPEG, ".JPEG"
    yield "junk behind the end", PNG + bytes(1000), ".png"
    exif = Image.Exif()
    exif[0x0112] = 3  # upside down
    yield "turned by EXIF", encoded(image, "JPEG", exif=exif), ".jpg"
    exif[0x0112] = 77
    yield "an orientation that is none", encoded(image, "JPEG", exif=exif), ".jpg"
    other = header(240, 320, 8, 2, 9, 0, 0)
    yield "a compression of another number", SIGNATURE + other + PNG[33:], ".png"
    yield "animated", encoded(image, save_all=True, append_images=[frame(1)]), ".png"
    yield "all black", encoded(Image.new("RGB", SIDE)), ".png"
    yield "all white", encoded(Image.new("RGB", SIDE, "white")), ".png"


def _in_folder(*contents: tuple[str, bytes]) -> Make:
    def make(box: Path, base: Base) -> None:
        (box / "frames").mkdir()
        for name, content in contents:
            (box / "frames" / name).write_bytes(content)

    return make


def _fifo(box: Path, base: Base) -> None:
    os.mkfifo(box / "x.png")


def _folder(box: Path, base: Base) -> None:
    (box / "x.png").mkdir()


def _link_to(target: str) -> Make:
    def make(box: Path, base: Base) -> None:
        (box / "x.png").symlink_to(target)

    return make


def _named(name: bytes) -> Make:
    def make(box: Path, base: Base) -> None:
        (box / "frames").mkdir()
        (box / "frames" / os.fsdecode(name)).write_bytes(PNG)

    return make


def _own_result(box: Path, base: Base) -> None:
    (box / "out").mkdir()
    (box / "out/x.png").write_bytes(PNG)


ASK = ("translate", "--run", "{resnet18}")
OUT = ("--out", "out")

PLACES: tuple[tuple[str, Make, tuple[str, ...], str], ...] = (
    ("a FIFO", _fifo, ("x.png",), "not a file"),
    ("a folder called x.png", _folder, ("x.png",), "holds no images"),
    ("a link to nowhere", _link_to("nowhere"), ("x.png",), "not there"),
    ("a link to itself", _link_to("x.png"), ("x.png",), "x.png"),
    ("a device", _link_to("/dev/zero"), ("x.png",), "not a file"),
    ("a folder without pictures", _in_folder(("notes.txt", b"")), ("frames",), "holds no images"),
    ("one of two damaged", _in_folder(("a.png", PNG), ("b.png", PNG[:300])), ("frames",), "b.png"),
    ("eight bombs", _in_folder(*((f"{n}.png", bomb()) for n in range(8))), ("frames",), "pixels"),
    ("its own result", _own_result, ("out/x.png",), "would be replaced"),
)

NAMES = (b"na\nme.png", b"caf\xe9.png", "naïve 🖐.png".encode(), b"--out.png", b"a" * 240 + b".png",
         b"'; rm -rf x.png", b"%s{}.png", b"counts.csv.png", b"A.PNG", b" .png")  # fmt: skip


def cases() -> Iterator[Case]:
    for name, content, suffix in _spoiled():
        file = f"x{suffix}"
        yield Case(f"picture: {name}", (*ASK, file, *OUT), holding(file, content), file)
    for name, content, suffix in _odd():
        file = f"x{suffix}"
        yield Case(f"picture: {name}", (*ASK, file, *OUT), holding(file, content), fine=True)
    for name, make, asked, says in PLACES:
        yield Case(f"picture: {name}", (*ASK, *asked, *OUT), make, says)
    for name in NAMES:
        yield Case(f"picture called {name[:20]!r}", (*ASK, "frames", *OUT), _named(name), fine=True)
    twice = _in_folder(("x.png", PNG), ("x.jpg", JPEG))
    yield Case("two pictures of one stem", (*ASK, "frames", *OUT), twice, fine=True)
    yield Case("one picture twice", (*ASK, "frames/x.png", "frames/x.png", *OUT), twice, fine=True)
