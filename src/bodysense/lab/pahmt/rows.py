"""The networks of PAHMT's Table 1: what each is, what it sees and learns by, and what the paper found."""

from __future__ import annotations

from dataclasses import dataclass

from bodysense.lab.pahmt.options import PAPER_LOSSES, Input, Kind, Loss


@dataclass(frozen=True)
class TableRow:
    """One row."""

    title: str
    kind: Kind = "cnn"
    input: Input = "arms-hands"
    losses: tuple[Loss, ...] = PAPER_LOSSES
    published: tuple[float, ...] = ()  # MPJPE of hands and overall, m; MPJRE of arms; of hands alone only the first


# The table does not print which marks the rows of the CNN carry; by the text the third and fourth of arms and hands
# differ from the first two by the loss of positions, and the last has both.
TABLE_1 = {
    "cnn-hands": TableRow("CNN, hands alone", "cnn", "hands", ("rotation", "gan"), (0.0300,)),
    "cnn-plain": TableRow("CNN", "cnn", losses=("rotation", "gan"), published=(0.0130, 0.0517, 0.0604)),
    "cnn-smooth": TableRow("CNN", "cnn", losses=("rotation", "smooth", "gan"), published=(0.0133, 0.0519, 0.0603)),
    "cnn-fk": TableRow("CNN", "cnn", losses=("rotation", "fk", "gan"), published=(0.0129, 0.0413, 0.0579)),
    "cnn": TableRow("CNN", "cnn", published=(0.0127, 0.0408, 0.0577)),
    "ahmt": TableRow("AHMT", "ahmt", published=(0.0098, 0.0316, 0.0445)),
    "pahmt": TableRow("PAHMT", "pahmt", published=(0.0087, 0.0274, 0.0375)),
}
