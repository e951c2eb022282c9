"""Orders the work on a dataset: groups of presses, and each shard after its groups."""

from collections import deque
from collections.abc import Container, Iterator

from t2twin.sim.dataset.shard import Work
from t2twin.sim.dataset.store import group_name
from t2twin.sim.sampling.plan import Group

QUEUED = 2
"""Works that are submitted at a time, as a multiple of the workers: none of them waits for the next
one, and few shards are unfinished at a time."""


class Schedule:
    """What is left to do.

    The longest shards are first, so that no long work runs alone at the end. Groups are in the
    order of the shards, so that few shards are unfinished at a time. A shard of one group is made
    at once.

    shards: the groups of each shard. pairs: number of those that are not made yet.
    """

    def __init__(self, shards: list[tuple[Group, ...]], made: Container[str] = ()) -> None:
        """made: names of the files of groups that exist."""
        self.shards = shards
        self.pairs = sum(
            group.pairs for groups in shards for group in groups if _name(group) not in made
        )
        self._made = made
        self._missing: dict[str, int] = {}
        self._whole: deque[tuple[Group, ...]] = deque()
        self._groups = {groups[0].batch.path: groups for groups in shards}
        self._next = self._in_order()

    @property
    def length(self) -> int:
        """Largest number of works at a time, for any number of workers."""
        return sum(len(groups) for groups in self.shards)

    def next(self) -> Work | None:
        """Work that can begin now; None where all is done, or waits for groups."""
        return self._whole.popleft() if self._whole else next(self._next, None)

    def done(self, work: Work) -> None:
        """Called with each finished work."""
        if isinstance(work, Group):
            path = work.batch.path
            self._missing[path] -= 1
            if not self._missing[path]:
                self._whole.append(self._groups[path])

    def _in_order(self) -> Iterator[Work]:
        for groups in sorted(self.shards, key=lambda groups: -groups[0].batch.pairs):
            missing = [group for group in groups if _name(group) not in self._made]
            if len(groups) == 1 or not missing:
                yield groups
            else:
                self._missing[groups[0].batch.path] = len(missing)
                yield from missing


def _name(group: Group) -> str:
    return group_name(group.batch.path, group.start)
