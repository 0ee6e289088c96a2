#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares what the daemon reads with independent readers: samples, spacing, origin, direction and names.

  formats_test.py DUMP PYTHON DATA [--write-page] [GROUP | PART …]

DUMP is volume_dump, PYTHON an interpreter that has the readers (zarr, h5py, …; requirements.txt), DATA the folder of the
real volumes. The groups `dicom`, `arrays` and `rest` are tests of their own, which run at once. Where there is no sample,
the independent library writes one. A missing reader or sample is a visible skip. The tables of renderer/data/import/types.md
are what the parts found; --write-page writes their rows, else they are compared.
"""
import difflib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile

if len(sys.argv) >= 4 and os.access(sys.argv[2], os.X_OK) and not os.environ.get('SPLATD_FORMATS_PYTHON'):
    os.environ['SPLATD_FORMATS_PYTHON'] = '1'
    os.execv(sys.argv[2], [sys.argv[2], *sys.argv])

os.environ['HDF5_PLUGIN_PRELOAD'] = '::'  # the readers load no plug-ins, such as the plug-ins of netCDF4
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from table import Table  # noqa: E402

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'renderer', 'data', 'import', 'types.md')
PARTS = {'types_part': ['numpy', 'zarr', 'h5py', 'netCDF4', 'tifffile'], 'small_part': ['numpy', 'SimpleITK'],
         'zarr_part': ['numpy', 'zarr', 'numcodecs'],
         'arrays_part': ['numpy', 'h5py', 'netCDF4', 'numcodecs'], 'tiff_part': ['numpy', 'tifffile'],
         'cf_part': ['numpy', 'h5py', 'netCDF4', 'zarr'], 'coordinates_part': ['numpy', 'h5py', 'netCDF4', 'SimpleITK', 'zarr'],
         'hdf5_part': ['numpy', 'h5py'],
         'medical_part': ['numpy', 'nibabel', 'pydicom'], 'dicom_frames_part': ['numpy', 'pydicom'],
         'volumes_part': ['numpy', 'nibabel', 'nrrd', 'mrcfile', 'SimpleITK', 'h5py', 'netCDF4'],
         'meaning_part': ['numpy', 'nibabel', 'nrrd', 'pydicom', 'SimpleITK', 'h5py', 'netCDF4', 'tifffile', 'zarr'],
         'reports_part': ['numpy'],
         'dicom_folder_part': ['numpy', 'pydicom'], 'dicom_series_part': ['numpy', 'pydicom', 'nibabel'],
         'dicom_highdicom_part': ['numpy', 'pydicom', 'highdicom'], 'dicom_packed_part': ['numpy', 'pydicom', 'PIL'],
         'convert_part': ['numpy', 'nibabel', 'nrrd', 'zarr']}
GROUPS = {'arrays': ['types_part', 'zarr_part', 'arrays_part', 'cf_part', 'coordinates_part', 'hdf5_part', 'tiff_part'], 'dicom': [part for part in PARTS if part.startswith('dicom_')]}
GROUPS['rest'] = [part for part in PARTS if part not in GROUPS['arrays'] + GROUPS['dicom']]


class Tool:
    """The functions that the parts use: dump() loads a source, equal() compares."""

    def __init__(self, dump, data, folder):
        self.dump_program, self.data, self.folder = dump, data, folder
        self.failed, self.checks, self.skipped = 0, 0, []
        self.table = Table()

    def path(self, name):
        return os.path.join(self.folder, name)

    def sample(self, *names):
        """A file of DATA/formats; None, and a note, if it is missing."""
        path = os.path.join(self.data, 'formats', *names)
        if os.path.exists(path):
            return path
        self.skipped.append(f'{path} is missing')
        return None

    def run(self, source, step=None):
        """`step` None: the reader chooses the time step."""
        out = self.path('samples.raw')
        done = subprocess.run([self.dump_program, source, out, *([] if step is None else [str(step)])], capture_output=True, text=True, check=False)
        return done, out

    def dump(self, source, step=None):
        """(description, samples as z, y, x); None, and a failure, if the file cannot be loaded."""
        import numpy
        done, out = self.run(source, step)
        if done.returncode != 0:
            self.fail(source, done.stdout.strip() or f'exit status {done.returncode}')
            return None, None
        info = json.loads(done.stdout)
        return info, numpy.fromfile(out, dtype=info['type']).reshape(info['dims'][::-1])

    def refused(self, source, *words):
        """The source is refused with an error that has these words."""
        self.refused_step(source, None, *words)

    def refused_step(self, source, step, *words):
        done, _ = self.run(source, step)
        self.checks += 1
        if done.returncode != 1 or not all(word in done.stdout for word in words):
            self.fail(source, f'expected an error with {words}, got: {done.stdout.strip()}')

    def typed(self, form, kind, source, expected, layout='', **wanted):
        """Calls equal(); adds the type in memory to the column `form` and the row `kind` (table.TYPES) of the page, and a row of layouts."""
        before = self.failed
        self.equal(source, expected, **wanted)
        if self.failed == before:
            self.table.add_type(form, kind, self.last_type)
            if layout:
                self.table.add_layout(form, layout, 'read')

    def layout(self, form, layout, source, expected, result='read', **wanted):
        """Calls equal(); adds a row of layouts to the page."""
        before = self.failed
        self.equal(source, expected, **wanted)
        if self.failed == before:
            self.table.add_layout(form, layout, result)

    def layout_refused(self, form, layout, source, *words):
        """Calls refused(); adds a row of layouts to the page."""
        before = self.failed
        self.refused(source, *words)
        if self.failed == before:
            self.table.add_layout(form, layout, f'refused: “{words[0]}”')

    def check_page(self, write):
        """Compares the rows of the formats that were tested with the page, or writes them."""
        with open(PAGE, encoding='utf-8') as file:
            page = file.read()
        found = self.table.joined(page)
        if write:
            with open(PAGE, 'w', encoding='utf-8') as file:
                file.write(found)
            return
        self.checks += 1
        if page != found:
            lines = difflib.unified_diff(page.splitlines(), found.splitlines(), 'page', 'found', lineterm='', n=0)
            self.fail('renderer/data/import/types.md', 'differs from what was found; formats_test.py --write-page writes it:\n' + '\n'.join(lines))

    def fail(self, source, text):
        self.failed += 1
        print(f'{source}: {text}')

    def equal(self, source, expected, step=None, warned=None, **wanted):
        """The samples are `expected` (z, y, x); spacing, origin, unit, name, … are `wanted`; a warning has the words `warned` ('' = there is none)."""
        import numpy
        info, samples = self.dump(source, step)
        if info is None:
            return
        self.checks += 1
        self.last_type = info['type']
        expected = numpy.asarray(expected)
        if samples.shape != expected.shape:
            self.fail(source, f'dims {samples.shape[::-1]}, expected {expected.shape[::-1]}')
            return
        same = numpy.array_equal(samples, expected.astype(samples.dtype), equal_nan=samples.dtype.kind == 'f')
        if not same:
            self.fail(source, f'the samples differ: {samples.ravel()[:8]}, expected {expected.ravel()[:8]}')
        told = ' | '.join(info['warnings'])
        if warned is not None and (warned not in told or (not warned and told)):
            self.fail(source, f'expected the warning "{warned}", got "{told}"')
        for key, value in wanted.items():
            got = info.get(key)
            is_same = numpy.allclose(got, value, rtol=1e-6, atol=1e-9) if isinstance(got, list) and key != 'warnings' else got == value
            if not is_same:
                self.fail(source, f'{key} is {got}, expected {value}')


def main():
    dump, _, data = sys.argv[1:4]
    wanted = [part for name in sys.argv[4:] if not name.startswith('--') for part in GROUPS.get(name, [name])]
    with tempfile.TemporaryDirectory(prefix='splat-formats-') as folder:
        tool = Tool(dump, data, folder)
        is_whole = True
        for part, modules in PARTS.items():
            if wanted and part not in wanted:
                continue
            missing = [m for m in modules if importlib.util.find_spec(m) is None]
            if missing:
                is_whole = False
                tool.skipped.append(f'{part}: not installed: {", ".join(missing)} (deploy/test.sh installs them)')
                continue
            tool.folder = os.path.join(folder, part)
            os.mkdir(tool.folder)
            importlib.import_module(part).check(tool)
        if is_whole:
            tool.check_page('--write-page' in sys.argv)
    for reason in tool.skipped:
        print(f'skipped: {reason}')
    print(f'{tool.checks} checks, {tool.failed} failed')
    if tool.failed:
        return 1
    return 0 if tool.checks else 77


if __name__ == '__main__':
    sys.exit(main())
