"""Runs and a table for the page's tests, and helpers that locate a ring and an image in the page."""

from dronecats.report.table import ReportTable, TableBlock, TableCell, TableColumn, TableRow
from tests.support.json_lines import rows

MODEL = {"provider": "vllm", "name": "Qwen/Qwen3.5-9B"}
EPISODES = {"yard-approaching-01": "go to the cyan car", "yard-approaching-02": "go to the other one",
            "yard-searching-01": "look for the cyan car"}  # fmt: skip
TABLE = ReportTable(
    name="main",
    title="Main results",
    caption="Success rate and oracle success rate.",
    columns=(
        TableColumn(name="pilot", title="Pilot", align="left"),
        TableColumn(name="sr", title="SR", group="Approaching", unit="%", better="more", cell="approaching"),
        TableColumn(name="ne_m", title="NE", unit="m", decimals=1, better="less"),
    ),
    blocks=(
        TableBlock(
            title="Models",
            rows=(
                TableRow(
                    entrant="vllm/Qwen/Qwen3.5-9B",
                    cells=(
                        TableCell(value="vllm/Qwen/Qwen3.5-9B"),
                        TableCell(value=100.0, low=34.2, high=100.0, count=2, of=2, best=True),
                        TableCell(value=3.87),
                    ),
                ),
            ),
        ),
    ),
    notes=("Intervals are Wilson's.",),
    command="dronecats report runs",
)


def point_of(runs, address, step, drone=0):
    """Return the point that a logged decision chose, as fractions of the image's width and height."""
    [decision] = [
        row for row in rows(runs / address / "decisions.jsonl") if (row["step"], row["drone"]) == (step, drone)
    ]
    return [x / 1000 for x in decision["action"]["point"]]


def ring_in(reader, view=0):
    """Return the centre of a ring, as fractions of its image, and the image's size in pixels."""
    return reader.script(
        """const view = document.querySelectorAll(".view")[arguments[0]];
        const [ring, box] = [".ring", ".picture"].map((css) => view.querySelector(css).getBoundingClientRect());
        return [(ring.x + ring.width / 2 - box.x) / box.width, (ring.y + ring.height / 2 - box.y) / box.height,
                box.width, box.height]""",
        view,
    )


def ring_is_at(reader, point, view=0):
    """Wait until a ring is at a point, within one pixel."""

    def there():
        x, y, wide, high = ring_in(reader, view)
        return abs(x - point[0]) * wide < 1.0 and abs(y - point[1]) * high < 1.0

    return reader.until(there)


def picture_is(reader, name, view=0):
    """Wait until a view shows the named image and has loaded it."""
    shown = """const image = document.querySelectorAll(".view img")[arguments[0]];
               return image?.complete && image.naturalWidth > 0 && image.src.endsWith(arguments[1])"""
    return reader.until(lambda: reader.script(shown, view, name))
