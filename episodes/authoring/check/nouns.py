"""What people call the things of the catalogue and of the maps."""

# What people call the assets; any other is called by its name.
NOUNS: dict[str, tuple[str, ...]] = {
    "suv": ("SUV",),
    "sedan": ("sedan", "saloon"),
    "hatchback": ("hatchback",),
    "pickup": ("pickup truck", "pickup"),
    "van": ("van",),
    "bus": ("bus",),
    "motorcycle": ("motorcycle", "motorbike"),
    "cyclist": ("cyclist", "bicycle"),
    "person": ("person", "pedestrian"),
    "pedestrian": ("person", "pedestrian"),
    "quadrotor": ("quadrotor", "drone on the stand"),
}


def nouns(asset: str) -> tuple[str, ...]:
    """Return what people call an asset or a kind of fixture, the commonest word first."""
    return NOUNS.get(asset, (asset.replace("-", " ").replace("_", " "),))


def kind_of(asset: str) -> str:
    """Return the kind that a map's instances of an asset have: written with hyphens, and who walks is a person, too."""
    return "person" if asset == "pedestrian" else asset.replace("_", "-")
