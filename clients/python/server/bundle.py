# SPDX-License-Identifier: Apache-2.0
"""Bundles the libraries of a wheel and their licences.

Usage: bundle.py WHEEL FOLDER     the repaired wheel goes to FOLDER

auditwheel copies the libraries. It expects some of them on every machine; this script bundles those too, except the
libraries that belong to glibc and those of GCC, which numpy needs as well. The licences come from Debian's packages.
"""

import os
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
# Below the folder of the importer, where its sandbox may read.
LIBRARIES = "/lib/splatd/libraries"
ALSO_BUNDLED = {"libz.so.1", "libexpat.so.1"}
# libarchive (for xar) and libnetcdf (for DAP4, a protocol for remote files) link it, and splatd uses neither. It would
# bring 33 MB of ICU. A library takes its place whose functions all return 0.
XML = "libxml2.so.2"
# libtiff links it for JBIG, a compression of fax pages. It is under the GPL, which the wheel is not.
JBIG = "libjbig.so.0"
JBIG_CODE = """
void jbg_dec_init(void *s) { (void)s; }
void jbg_dec_free(void *s) { (void)s; }
int jbg_dec_in(void *s, unsigned char *data, unsigned long size, unsigned long *count)
{ (void)s; (void)data; (void)size; (void)count; return 0x30; }
void *jbg_dec_getimage(const void *s, int plane) { (void)s; (void)plane; return 0; }
unsigned long jbg_dec_getsize(const void *s) { (void)s; return 0; }
const char *jbg_strerror(int code) { (void)code; return "JBIG is not supported"; }
int jbg_newlen(unsigned char *data, unsigned long size) { (void)data; (void)size; return 0x30; }
void jbg_enc_init(void) {}
void jbg_enc_out(void) {}
void jbg_enc_free(void) {}
"""
HASH = re.compile(r"-[0-9a-f]{8}(?=\.)")


class Policies(auditwheel.policy.WheelPolicies):
    """The policies of auditwheel, with fewer libraries that every machine has."""

    def __init__(self, **arguments):
        super().__init__(**arguments)
        for policy in self._policies:
            object.__setattr__(policy, "whitelist", frozenset(policy.whitelist) - ALSO_BUNDLED)


def make_xml(folder, libraries):
    """Builds the library that takes the place of libxml2, with the symbols and versions that `libraries` refer to."""
    symbols = subprocess.run(["nm", "-D", "--undefined-only", *libraries], capture_output=True, text=True, check=True)
    versions = {}
    for name, version in sorted(set(re.findall(r"U (\w+)@(LIBXML2_[\d.]+)", symbols.stdout))):
        versions.setdefault(version, []).append(name)
    code, script = "#include <stdlib.h>\n", ""
    for version, names in versions.items():
        script += f"{version} {{ global: {'; '.join(names)}; }};\n"
        for name in names:
            code += (
                "void (*xmlFree)(void *) = free;\n" if name == "xmlFree" else f"void *{name}(void) {{ return NULL; }}\n"
            )
    script += "NONE { local: *; };\n"
    (folder / "xml.c").write_text(code, encoding="utf-8")
    (folder / "xml.map").write_text(script, encoding="utf-8")
    options = ["-shared", "-fPIC", f"-Wl,-soname,{XML}", f"-Wl,--version-script={folder}/xml.map"]
    subprocess.run(["cc", *options, f"{folder}/xml.c", "-o", f"{folder}/{XML}"], check=True)


def make_jbig(folder):
    """Builds the library that takes the place of libjbig: it decodes nothing, and libtiff tells the user so."""
    (folder / "jbig.c").write_text(JBIG_CODE, encoding="utf-8")
    options = ["-shared", "-fPIC", f"-Wl,-soname,{JBIG}"]
    subprocess.run(["cc", *options, f"{folder}/jbig.c", "-o", f"{folder}/{JBIG}"], check=True)


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
    names = sorted(HASH.sub("", path.name) for path in (package / LIBRARIES.lstrip("/")).iterdir())
    packages = {}
    for name in names:
        if name not in (XML, JBIG):
            found = package_of(name)
            if not found:
                sys.exit(f"bundle.py: no Debian package has {name}: its licence is unknown")
            packages.setdefault(found, []).append(name)
    lines = []
    for name, files in sorted(packages.items()):
        fields = "${Version}\t${source:Package} ${source:Version}"
        version, source = (
            subprocess.run(["dpkg-query", "-W", f"-f={fields}\n", name], capture_output=True, text=True, check=True)
            .stdout.splitlines()[0]
            .split("\t")
        )
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
        make_xml(
            Path(folder), [f"/usr/lib/x86_64-linux-gnu/{name}" for name in ("libarchive.so.13", "libnetcdf.so.19")]
        )
        make_jbig(Path(folder))
        os.environ["LD_LIBRARY_PATH"] = folder
        options = ["--plat", PLATFORM, "--only-plat", "--lib-sdir", LIBRARIES, "--wheel-dir", folder]
        sys.argv = ["auditwheel", "repair", *options, str(wheel)]
        status = auditwheel_main()
        if status:
            sys.exit(status)
        del os.environ["LD_LIBRARY_PATH"]
        (repaired,) = Path(folder).glob("*.whl")
        with InWheelCtx(repaired, output / repaired.name) as context:
            add_licences(Path(context.name))
        print(output / repaired.name)


main()
