"""Checks of a page with wide tables on a phone, in a real browser."""

from typing import Any

import cv2
import numpy as np

PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
DESK = {"width": 1280, "height": 800, "deviceScaleFactor": 1, "mobile": False}
HIDDEN = """document.querySelectorAll("details").forEach((each) => each.open = true);
            return [...document.querySelectorAll(".wide")].map((box, number) => [number, box])
            .filter(([_, box]) => box.scrollWidth > box.clientWidth).map(([number]) => number)"""
COVERED = """const box = document.querySelectorAll(".wide")[arguments[0]];
             box.scrollLeft = box.scrollWidth;
             return [...box.querySelectorAll("tbody tr > th[scope=row]")].filter((head) => {
               scrollTo(0, scrollY + head.getBoundingClientRect().top - innerHeight / 2);
               const {left, top, right, bottom} = head.getBoundingClientRect(), edge = box.getBoundingClientRect();
               const seen = document.elementFromPoint(left + 5, (top + bottom) / 2);
               return left < edge.left - 1 || right > edge.right || !head.contains(seen);
             }).map((head) => head.textContent)"""
EDGE = """const box = document.querySelectorAll(".wide")[arguments[0]];
          scrollTo(0, scrollY + box.getBoundingClientRect().top - innerHeight / 4);
          box.scrollLeft = arguments[1] ? box.scrollWidth : 0;
          return box"""


def sized(driver: Any, size: dict[str, Any]) -> None:
    """Give the browser a screen of this size."""
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def wider_than_shown(driver: Any) -> list[int]:
    """Unfold everything, and return the numbers of the tables that need scrolling."""
    widths: list[int] = driver.execute_script(HIDDEN)
    return widths


def row_heads_out_of_sight(driver: Any, number: int) -> list[str]:
    """Return the heads of a table's rows that are out of sight once the table is scrolled to its end."""
    rows: list[str] = driver.execute_script(COVERED, number)
    return rows


def right_edge_is_darker(driver: Any, number: int, *, at_end: bool) -> bool:
    """Return whether a table's right edge is in a shadow, scrolled to the beginning, or to the end if `at_end`."""
    box = driver.execute_script(EDGE, number, at_end)
    shown: Any = cv2.imdecode(np.frombuffer(box.screenshot_as_png, np.uint8), cv2.IMREAD_GRAYSCALE)
    edge, inner = shown[:, -4:-2], shown[:, -60:-40]
    return float(np.median(edge)) < float(np.median(inner)) - 5


def assert_rows_can_be_read_while_scrolling(driver: Any) -> None:
    """Assert that a table wider than the window keeps its first column in sight, and a shadow at hidden columns."""
    wide = wider_than_shown(driver)
    assert wide
    for number in wide:
        assert row_heads_out_of_sight(driver, number) == []
    assert right_edge_is_darker(driver, wide[0], at_end=False)
    assert not right_edge_is_darker(driver, wide[0], at_end=True)
