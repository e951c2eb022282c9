"""Words of messages."""


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number and a noun, as "1 pair" or "2 pairs". plural: by default the noun and an s."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"
