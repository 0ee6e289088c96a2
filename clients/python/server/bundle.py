# SPDX-License-Identifier: Apache-2.0
"""Bundles the libraries of a wheel and their licences.

Usage: bundle.py WHEEL FOLDER     the repaired wheel goes to FOLDER

auditwheel copies the libraries. It expects some of them on every machine; this script bundles those too, except the
libraries that belong to glibc and those of GCC, which numpy needs as well. The licences come from Debian's packages.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import auditwheel.policy
from auditwheel.main import main as auditwheel_main
from auditwheel.wheeltools import InWheelCtx

PLATFORM = "manylinux_2_36_x86_64"
ALSO_BUNDLED = {"libz.so.1", "libexpat.so.1"}
# What is in a program, not beside it, and the header-only code of libraries.
STATIC = ["libarchive13"]
HASH = re.compile(r"-[0-9a-f]{8}(?=\.so)")


class Policies(auditwheel.policy.WheelPolicies):
    """The policies of auditwheel, with fewer libraries that every machine has."""

    def __init__(self, **arguments):
        super().__init__(**arguments)
        for policy in self._policies:
            object.__setattr__(policy, "whitelist", frozenset(policy.whitelist) - ALSO_BUNDLED)


def package_of(library):
    """The Debian package of a file name, or None for a library of this project."""
    done = subprocess.run(["dpkg-query", "-S", f"*/{library}"], capture_output=True, text=True, check=False)
    packages = {line.split(":")[0] for line in done.stdout.splitlines() if line.endswith("/" + library)}
    return min(packages) if packages else None


def add_licences(folder):
    """Writes the licences of all bundled libraries, and a list of the packages with their versions."""
    package = folder / "splatd_server"
    licences = package / "licences"
    licences.mkdir()
    names = sorted(HASH.sub("", path.name) for path in (folder / "splatd_server.libs").iterdir())
    packages = {}
    for name in names:
        if name != "libxml2.so.2":
            found = package_of(name)
            if not found:
                sys.exit(f"bundle.py: no Debian package has {name}: its licence is unknown")
            packages.setdefault(found, []).append(name)
    for name in STATIC:
        packages.setdefault(name, []).append("(static)")
    lines = []
    for name, files in sorted(packages.items()):
        fields = "${Version}\t${source:Package} ${source:Version}"
        version, source = subprocess.run(
            ["dpkg-query", "-W", f"-f={fields}\n", name], capture_output=True, text=True, check=True
        ).stdout.splitlines()[0].split("\t")
        shutil.copyfile(f"/usr/share/doc/{name}/copyright", licences / name)
        lines.append(f"{name}\t{version}\t{source}\t{' '.join(files)}\n")
    (licences / "PACKAGES.tsv").write_text("package\tversion\tsource\tfiles\n" + "".join(lines), encoding="utf-8")
    for path in Path("/usr/share/common-licenses").iterdir():
        if path.is_file() and not path.is_symlink():
            shutil.copyfile(path, licences / f"common-{path.name}")


def main():
    wheel, output = (Path(name).resolve() for name in sys.argv[1:])
    for module in list(sys.modules.values()):
        if getattr(module, "WheelPolicies", None) is Policies.__base__:
            module.WheelPolicies = Policies
    with tempfile.TemporaryDirectory() as folder:
        sys.argv = ["auditwheel", "repair", "--plat", PLATFORM, "--only-plat", "--wheel-dir", folder, str(wheel)]
        status = auditwheel_main()
        if status:
            sys.exit(status)
        (repaired,) = Path(folder).glob("*.whl")
        with InWheelCtx(repaired, output / repaired.name) as context:
            add_licences(Path(context.path if hasattr(context, "path") else context.name))
        print(output / repaired.name)


main()
