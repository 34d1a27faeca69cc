"""Fingerprints of every six consecutive words of the paper's prompt. They detect copied text without storing it.

`python -m tests.agent.paper_words paper.tex` regenerates them from the paper's source.
"""

import hashlib
import re
import sys
from pathlib import Path

FINGERPRINTS = Path(__file__).with_name("paper_words.txt")
IN_A_ROW = 6
PASSAGES = (r"\\subsection\{The Prompt\}.*?\\subsection\{Metrics\}", r"label=\{lst:prompt\}\].*?\\end\{lstlisting\}")


def rows(text: str) -> dict[str, str]:
    """Return fingerprint → words for every six consecutive words, without the JSON actions, which every prompt has."""
    words = re.findall(r"[a-z0-9]+", re.sub(r'{"action":.*}', "\n", text).lower())
    several = (" ".join(words[i : i + IN_A_ROW]) for i in range(len(words) - IN_A_ROW + 1))
    return {hashlib.sha256(row.encode()).hexdigest()[:10]: row for row in several}


def paper_fingerprints() -> set[str]:
    return set(FINGERPRINTS.read_text().split())


if __name__ == "__main__":
    source = Path(sys.argv[1]).read_text(encoding="utf-8")
    fingerprints = {
        key for passage in PASSAGES for text in re.findall(passage, source, re.DOTALL) for key in rows(text)
    }
    FINGERPRINTS.write_text("\n".join(sorted(fingerprints)) + "\n")
