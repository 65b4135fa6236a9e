"""Where on a person each vertex of a shape lies, by a small trained network.

It reads nothing that turns, moves or grows with a shape. It was trained on bodies that
a script makes of CC0 data, whole and in parts, and on animals, birds, tools and skulls
(`experiments/learn`), of which it is to say that they are no people.

Read in this order:

- `_inputs`: a `Spectrum` to a `NetworkInput`
- `_network`: learned diffusion, and the trained weights
- `_places`: chances of places on a person; whether a shape is taken for one
"""

from jfsf.learned._places import (
    agreement,
    best_agreement,
    place_chances,
    places_on_person,
)

__all__ = ["agreement", "best_agreement", "place_chances", "places_on_person"]
