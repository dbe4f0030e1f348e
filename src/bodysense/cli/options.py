"""Options that several commands share."""

from __future__ import annotations

from typing import Annotated

import tyro

from bodysense.io.rigs.options import ReadingOptions

Reading = Annotated[ReadingOptions, tyro.conf.arg(name="")]  # of a motion file: --unit, --up, --floor …
