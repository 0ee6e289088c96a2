# SPDX-License-Identifier: Apache-2.0
"""Installs libsplat into a private prefix and uses it as another project would.

The example program is built against the installation with pkg-config and with the CMake package, each with
the shared and the static library. It draws a built-in volume and a file, and its images are checked.
"""
import glob
import os
import re
import shutil
import struct
import subprocess
import tempfile
import unittest
import zlib

SOURCE, BUILD = os.environ['SPLATD_SOURCE'], os.environ['SPLATD_BUILD']
CMAKE, CC, CXX = os.environ['CMAKE'], os.environ['CC'], os.environ['CXX']
EXAMPLE = os.path.join(SOURCE, 'clients/example/render_png.c')
# Environment variables that a program on another machine does not have.
UNSET = ('LD_LIBRARY_PATH', 'PKG_CONFIG_PATH', 'CMAKE_PREFIX_PATH')


def run(*command, **extra):
    """Returns the output of a command. If it fails, the failure shows its error output."""
    environment = {k: v for k, v in os.environ.items() if k not in UNSET} | extra
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise AssertionError(f'{" ".join(command)}: exit status {done.returncode}\n{done.stdout}{done.stderr}')
    return done.stdout


def read_png(path):
    """Returns (width, height, rows of (r, g, b)) of a PNG with 8 bits per channel and the filters None, Sub and Up."""
    with open(path, 'rb') as file:
        data = file.read()
    assert data[:8] == b'\x89PNG\r\n\x1a\n', f'{path} is not a PNG'
    at, packed = 8, b''
    while at < len(data):
        size, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b'IHDR':
            width, height, depth, color = struct.unpack('>IIBB', body[:10])
        elif kind == b'IDAT':
            packed += body
        at += 12 + size
    assert depth == 8 and color in (2, 6), (depth, color)
    channels, plain = {2: 3, 6: 4}[color], zlib.decompress(packed)
    stride, above, rows = width * channels, bytes(width * channels), []
    for y in range(height):
        row = bytearray(plain[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        kind = plain[y * (stride + 1)]
        assert kind in (0, 1, 2), f'row {y} has filter {kind}'
        for x in range(stride):
            before = above[x] if kind == 2 else row[x - channels] if kind == 1 and x >= channels else 0
            row[x] = (row[x] + before) & 255
        above = bytes(row)
        rows.append([tuple(row[x:x + 3]) for x in range(0, stride, channels)])
    return width, height, rows


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix='splat-install-')
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.prefix = os.path.join(cls.folder, 'prefix')
        run(CMAKE, '--install', BUILD, '--prefix', cls.prefix)
        cls.pkgconfig = os.path.dirname(cls.find('splat.pc'))
        cls.libraries = os.path.dirname(cls.pkgconfig)
        cls.images = {}

    @classmethod
    def find(cls, name):
        found = glob.glob(os.path.join(cls.prefix, '**', name), recursive=True)
        assert found, f'{name} is not installed'
        return found[0]

    def flags(self, *options):
        return run('pkg-config', *options, 'splat', PKG_CONFIG_PATH=self.pkgconfig).split()

    def draw(self, program, source, **extra):
        """Renders `source` with the program and returns the bytes of the PNG."""
        output = os.path.join(self.folder, 'image.png')
        run(program, source, output, **extra)
        with open(output, 'rb') as file:
            return file.read()

    def check_images(self, program, **extra):
        """Renders a built-in volume and a file, which the installed importer reads. All programs must give the same bytes."""
        sphere = os.path.join(self.folder, 'sphere.nrrd')
        n = 24
        voxels = bytes(255 if sum((2 * v + 1 - n) ** 2 for v in (i, j, k)) < (n - 6) ** 2 else 0
                       for k in range(n) for j in range(n) for i in range(n))
        with open(sphere, 'wb') as file:
            file.write(f'NRRD0004\ntype: uint8\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\n\n'.encode() + voxels)
        for name, source in (('demo', 'demo:engine?size=32'), ('file', sphere)):
            image = self.draw(program, source, **extra)
            self.assertEqual(image, self.images.setdefault(name, image), f'{program} renders {name} differently')
            width, height, rows = read_png(os.path.join(self.folder, 'image.png'))
            self.assertEqual((width, height), (512, 512))
            self.assertEqual(rows[0][0], (0, 0, 0), 'the background is not black')
            self.assertGreater(max(rows[256][256]), 40, 'the volume is not in the middle')

    def test_pkg_config_and_the_shared_library(self):
        program = os.path.join(self.folder, 'shared')
        run(CC, '-std=c17', '-Wall', '-Wextra', '-Werror', EXAMPLE, '-o', program, *self.flags('--cflags', '--libs'))
        self.check_images(program, LD_LIBRARY_PATH=self.libraries)

    def test_pkg_config_and_the_static_library(self):
        program = os.path.join(self.prefix, 'bin', 'static') # the library finds the importer relative to this path
        os.makedirs(os.path.dirname(program), exist_ok=True)
        libraries = [os.path.join(self.libraries, 'libsplat.a') if flag == '-lsplat' else flag
                     for flag in self.flags('--static', '--libs')]
        run(CC, '-std=c17', EXAMPLE, '-o', program, *self.flags('--cflags'), *libraries)
        self.check_images(program)

    def test_cmake_package(self):
        for static in ('OFF', 'ON'):
            build = os.path.join(self.folder, 'cmake-' + static)
            run(CMAKE, '-S', os.path.dirname(EXAMPLE), '-B', build, f'-DCMAKE_PREFIX_PATH={self.prefix}',
                f'-DSPLAT_STATIC={static}', f'-DCMAKE_C_COMPILER={CC}')
            run(CMAKE, '--build', build)
            program = os.path.join(build, 'render_png')
            self.draw(program, 'demo:engine?size=32')
            if static == 'OFF':
                self.check_images(program)

    def test_the_importer_can_be_set(self):
        program = os.path.join(self.folder, 'importer')
        code = os.path.join(self.folder, 'importer.c')
        with open(code, 'w', encoding='utf-8') as file:
            file.write('#include <stdio.h>\n#include "sp/volume.h"\n'
                       'int main(int argc, char **argv) {\n'
                       '    struct sp_error err;\n'
                       '    struct sp_load_options options = { .importer = argv[argc - 1] };\n'
                       '    struct sp_volume *volume = sp_volume_load(argv[1], &options, &err);\n'
                       '    puts(volume ? "loaded" : err.place);\n'
                       '    sp_volume_unref(&volume);\n'
                       '    return 0;\n}\n')
        run(CC, code, '-o', program, *self.flags('--cflags', '--libs'))
        data = os.path.join(self.folder, 'ramp.nrrd')
        with open(data, 'wb') as file:
            file.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n' + bytes(range(8)))
        for importer, answer in ((self.find('splat-import'), 'loaded'), ('/nonexistent/reader', '/nonexistent/reader')):
            self.assertEqual(run(program, data, importer, LD_LIBRARY_PATH=self.libraries).strip(), answer)

    def test_headers_compile_and_link_as_cpp(self):
        names = sorted(os.path.basename(path) for path in glob.glob(os.path.join(self.prefix, 'include/sp/*.h')))
        self.assertIn('renderer.h', names)
        for name in names:
            code, program = os.path.join(self.folder, 'one.cpp'), os.path.join(self.folder, 'one')
            with open(code, 'w', encoding='utf-8') as file:
                file.write(f'#include "sp/{name}"\n#include "sp/version.h"\n#include <cstring>\n'
                           'int main() { return std::strcmp(sp_version_string(), "") == 0 || sp_version() != SP_VERSION; }\n')
            run(CXX, '-std=c++17', '-Wall', '-Wextra', '-Werror', '-pedantic', code, '-o', program,
                *self.flags('--cflags', '--libs'))
            run(program, LD_LIBRARY_PATH=self.libraries)

    def test_only_the_public_functions_are_exported(self):
        library = os.path.join(self.libraries, 'libsplat.so')
        declared = set()
        for path in glob.glob(os.path.join(self.prefix, 'include/sp/*.h')):
            with open(path, encoding='utf-8') as file:
                code = re.sub(r'/\*.*?\*/', '', file.read(), flags=re.S)
            for declaration in re.findall(r'^SP_API [^;]*;', code, re.M):
                declared.add(re.search(r'(sp_\w+)\(', declaration).group(1))
        exported = {line.split()[-1] for line in run('nm', '-D', '--defined-only', library).splitlines()}
        self.assertEqual(exported, declared)

    def test_the_version_is_the_same_everywhere(self):
        version = run('pkg-config', '--modversion', 'splat', PKG_CONFIG_PATH=self.pkgconfig).strip()
        with open(self.find('version.h'), encoding='utf-8') as file:
            numbers = re.findall(r'#define SP_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)', file.read())
        self.assertEqual(version, '.'.join(numbers))
        soname = re.search(r'\(SONAME\).*\[(.*)\]', run('readelf', '-d', os.path.join(self.libraries, 'libsplat.so')))
        self.assertEqual(soname.group(1), 'libsplat.so.' + '.'.join(numbers[:2]))


if __name__ == '__main__':
    unittest.main()
