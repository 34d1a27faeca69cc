"""The paper's prompt as fingerprints of every six words in a row, so that ours can be told from it without holding it.

`python -m tests.agent.paper_words paper.tex` writes them anew from the paper's source.
"""

import hashlib
import re
import sys
from pathlib import Path

FINGERPRINTS = Path(__file__).with_name("paper_words.txt")
IN_A_ROW = 6
PASSAGES = (r"\\subsection\{The Prompt\}.*?\\subsection\{Metrics\}", r"label=\{lst:prompt\}\].*?\\end\{lstlisting\}")


def rows(text: str) -> dict[str, str]:
    """Return fingerprint → words, of every six words in a row; the declared JSON, which all must share, is no words."""
    words = re.findall(r"[a-z0-9]+", re.sub(r'{"action":.*}', "\n", text).lower())
    several = (" ".join(words[i : i + IN_A_ROW]) for i in range(len(words) - IN_A_ROW + 1))
    return {hashlib.sha256(row.encode()).hexdigest()[:10]: row for row in several}


def known() -> set[str]:
    return set(FINGERPRINTS.read_text().split())


if __name__ == "__main__":
    source = Path(sys.argv[1]).read_text(encoding="utf-8")
    found = {key for passage in PASSAGES for text in re.findall(passage, source, re.DOTALL) for key in rows(text)}
    FINGERPRINTS.write_text("\n".join(sorted(found)) + "\n")
