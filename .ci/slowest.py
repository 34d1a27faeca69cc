"""Prints the twenty slowest tests of some JUnit files, and how long each file's tests took."""

import sys
import xml.etree.ElementTree as ElementTree

cases = []
for path in sys.argv[1:]:
    suite = ElementTree.parse(path).getroot().find("testsuite")
    assert suite is not None
    print(f"{path}: {suite.get('tests')} tests in {float(suite.get('time', 0)):.0f} s")
    cases += suite.iter("testcase")
for case in sorted(cases, key=lambda case: -float(case.get("time", 0)))[:20]:
    print(f"{float(case.get('time', 0)):7.1f} s  {case.get('classname')}::{case.get('name')}")
