"""Records in shared memory that one process writes and another reads, and neither waits.

The writer overwrites its oldest record, the reader takes what it finds. A record is marked unready
while it is written, so that a reader never sees half of one.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Ring:
    """Records of one writer; their field `number` counts what was posted, and is -1 where nothing
    was or where a record is being written."""

    def __init__(self, records: NDArray[Any]) -> None:
        self._records, self._posted = records, int(records["number"].max()) + 1

    def post(self, **fields: object) -> None:
        """Write the next record over the oldest one."""
        slot = self._records[self._posted % len(self._records)]
        slot["number"] = -1
        for name, value in fields.items():
            slot[name] = value
        slot["number"] = self._posted
        self._posted += 1

    def after(self, number: int) -> list[np.void]:
        """Copies of the records after record `number` that are still here, oldest first."""
        numbers = self._records["number"].copy()
        found: list[np.void] = []
        for wanted in np.sort(numbers[numbers > number]):
            slot = self._records[wanted % len(self._records)]
            copy: Any = slot.copy()
            if copy["number"] == wanted == slot["number"]:
                found.append(copy)
        return found
