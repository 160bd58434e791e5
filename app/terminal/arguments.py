"""Types of options whose help would else read `{None}|PATH`."""

from pathlib import Path
from typing import Annotated

import tyro

File = Annotated[Path | None, tyro.conf.arg(metavar="PATH")]
Number = Annotated[int | None, tyro.conf.arg(metavar="N")]
Amount = Annotated[float | None, tyro.conf.arg(metavar="N")]
Name = Annotated[str | None, tyro.conf.arg(metavar="NAME")]
