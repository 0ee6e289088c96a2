# SPDX-License-Identifier: Apache-2.0
"""Compares the files of a wheel with the README. Usage: check_files.py WHEEL README

Each library that a program needs is in the wheel, or belongs to glibc or GCC. Each package of Debian that gave a
library is in the table of the README with a licence in the wheel, and the README names no other.
"""

import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

SYSTEM = re.compile(r"(lib(c|m|dl|pthread|rt|resolv|gcc_s|stdc\+\+)|ld-linux-x86-64)\.so\.\d")
LIMIT = 40_000_000


def main():
    wheel, readme = (Path(name) for name in sys.argv[1:])
    wrong = []
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
        top = Path(folder)
        libraries = {path.name for path in (top / "splatd_server/lib/splatd/libraries").iterdir()}
        for path in top.rglob("*"):
            if path.is_file() and path.read_bytes()[:4] == b"\x7fELF":
                text = subprocess.run(["objdump", "-p", path], capture_output=True, text=True, check=True).stdout
                for name in re.findall(r"NEEDED\s+(\S+)", text):
                    if name not in libraries and not SYSTEM.fullmatch(name):
                        wrong.append(f"{path.name} needs {name}, which is not in the wheel")
        wrong += [f"{name} is in the wheel" for name in libraries if re.match(r"lib(GL|EGL|OpenImageIO|icu)", name)]
        rows = (top / "splatd_server/licences/PACKAGES.tsv").read_text(encoding="utf-8").splitlines()[1:]
        bundled = {row.split("\t")[0] for row in rows}
        wrong += [
            f"{name} has no licence" for name in bundled if not (top / "splatd_server/licences" / name).stat().st_size
        ]
    named = set(
        re.findall(r"`([a-z0-9.+-]+)`", readme.read_text(encoding="utf-8").split("## Libraries")[1].split("\n## ")[0])
    )
    wrong += [f"the README does not list {name}" for name in sorted(bundled - named)]
    wrong += [f"the README lists {name}, which is not bundled" for name in sorted(named - bundled)]
    if wheel.stat().st_size > LIMIT:
        wrong.append(f"the wheel has {wheel.stat().st_size} bytes, more than {LIMIT}")
    if wrong:
        sys.exit("\n".join(wrong))
    print(f"{wheel.name}: {wheel.stat().st_size} bytes, {len(libraries)} libraries of {len(bundled)} packages")


main()
