#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""gpu_test.py SPLATD SPLATCTL SPLAT-BENCH: what the programs say of GPUs, here and on machines without one: no libEGL (an
empty file in its place cannot be loaded), no driver (glvnd is told of none), an OpenGL that is too old and software alone
(Mesa is told so)."""
import json
import os
import re
import subprocess
import sys
import tempfile
import unittest
import urllib.request

SPLATD, SPLATCTL, BENCH = sys.argv[1:4]
del sys.argv[1:4]
FOLDER = tempfile.TemporaryDirectory()
with open(os.path.join(FOLDER.name, 'libEGL.so.1'), 'wb'):
    pass
MACHINES = {
    'no libEGL': ({'LD_LIBRARY_PATH': FOLDER.name}, 'libEGL.so.1 cannot be loaded: '),
    'no driver': ({'__EGL_VENDOR_LIBRARY_FILENAMES': ''}, 'EGL does not have a driver'),
    'old GL': ({'MESA_GL_VERSION_OVERRIDE': '3.3'}, 'a core profile of 4.3 is needed'),
    'software': ({}, 'this device is software GL'),
}
# The environment of Mesa hides a GPU of this machine.
MESA = {'__EGL_VENDOR_LIBRARY_FILENAMES': '/usr/share/glvnd/egl_vendor.d/50_mesa.json', 'LIBGL_ALWAYS_SOFTWARE': '1'}


def run(program, *arguments, machine=None):
    environment = {k: v for k, v in os.environ.items() if not k.startswith('SPLATD_')}
    if machine:
        environment.update({**MESA, **MACHINES[machine][0]})
    return subprocess.run([program, *arguments], capture_output=True, text=True, env=environment, timeout=120, check=False)


def paragraphs(text):
    """{(backend, place): {what: value}} and the last line of what --probe prints."""
    found, lines = {}, text.splitlines()
    for line in lines[:-1]:
        if line.startswith(' '):
            what, value = re.fullmatch(r'  (\w+(?: \w+)?) +(\S.*)', line).groups()
            entry[what] = value
        else:
            backend, place, broken = re.fullmatch(r'([\w-]+): (.*?)( does not work)?', line).groups()
            entry = found[backend, place] = {}
            assert not broken or 'because' not in entry
            entry['works'] = not broken
    return found, lines[-1]


def builds_gl():
    return 'gl-software' in run(SPLATD, '--help').stdout


def has_software():
    return 'software GL' in run(SPLATD, '--probe', machine='software').stdout


class Probe(unittest.TestCase):
    def probe(self, machine):
        done = run(SPLATD, '--probe', machine=machine)
        self.assertEqual(done.stderr, '')
        found, last = paragraphs(done.stdout)
        for (backend, place), entry in found.items():
            self.assertEqual(entry['works'], 'because' not in entry, (backend, place))
            self.assertEqual(entry['works'], 'device' in entry, (backend, place))
        cpu = found['cpu', 'processor']
        self.assertIn('scalar', cpu['sets'])
        self.assertGreaterEqual(int(cpu['cores']), 1)
        return done.returncode, found, last

    def test_this_machine(self):
        status, found, last = self.probe(None)
        works = any(entry['works'] and backend == 'gl' for (backend, _), entry in found.items())
        self.assertEqual((status, last), (0, 'A GPU works.') if works else (3, 'No GPU works.'))

    def test_machines_without(self):
        for machine, (_, reason) in MACHINES.items():
            with self.subTest(machine):
                status, found, last = self.probe(machine)
                self.assertEqual((status, last), (3, 'No GPU works.'))
                if not builds_gl():
                    self.assertIn('this build', found['none', 'GPU']['because'])
                elif machine != 'software' and (machine != 'old GL' or has_software()):
                    self.assertIn(reason, ' '.join(entry.get('because', '') for entry in found.values()))

    def test_software_is_no_gpu(self):
        if not has_software():
            self.skipTest('no software GL is installed')
        _, found, _ = self.probe('software')
        entry = next(entry for (backend, _), entry in found.items() if backend == 'gl-software')
        self.assertIn('never as a GPU', entry['kind'])
        for what in ('vendor', 'OpenGL', 'driver', 'video memory', 'storage block', 'storage blocks', 'shared memory', 'work group'):
            self.assertIn(what, entry)
        # OpenGL 4.3 guarantees these limits.
        self.assertRegex(entry['storage block'], r'^\d+ [MG]iB$')
        self.assertGreaterEqual(int(entry['storage blocks'].split()[0]), 8)
        self.assertRegex(entry['shared memory'], r'^\d+ KiB$')
        self.assertGreaterEqual(int(entry['work group'].split()[0]), 1024)
        self.assertRegex(entry['OpenGL'], r'^4\.[3-6]')


@unittest.skipUnless(builds_gl(), 'this build has no GPU backend')
class Refusals(unittest.TestCase):
    def refuses(self, machine, reason, options):
        done = run(SPLATD, '--listen', '127.0.0.1:0', *options, machine=machine)
        self.assertEqual((done.returncode, done.stdout), (1, ''))
        last = done.stderr.splitlines()[-1]
        self.assertRegex(last, '^splatd: backend gl(-software)? does not start: ')
        if has_software() or machine.startswith('no '):
            self.assertIn(MACHINES[reason][1], last)

    def test_a_gpu_that_is_required_is_missed_at_the_start(self):
        for machine in MACHINES:
            for options in ('--backend', 'gl'), ('--backend', 'gl', '--require-gpu'), ('--require-gpu',):
                with self.subTest(machine=machine, options=options):
                    # The other machines have only software GL, too old or not.
                    self.refuses(machine, machine if machine.startswith('no ') else 'software', options)
        for machine in 'no libEGL', 'no driver', 'old GL':
            with self.subTest(machine=machine):
                self.refuses(machine, machine, ('--backend', 'gl-software'))
        for options in ('--backend', 'cpu'), ('--backend', 'gl-software'):
            done = run(SPLATD, '--listen', '127.0.0.1:0', '--require-gpu', *options)
            self.assertEqual(done.returncode, 2)
            self.assertIn(f'backend {options[1]} does not use one', done.stderr)

    def test_a_gpu_that_is_not_there(self):
        for program, arguments in ((SPLATD, ('--listen', '127.0.0.1:0')),
                                   (SPLATCTL, ('render', '--local', '--volume', 'demo:phantom?size=8', '--out', '-')),
                                   (BENCH, ('--volume', 'demo:phantom?size=8'))):
            done = run(program, *arguments, '--backend', 'gl', '--gpu', '63', machine='software')
            self.assertEqual(done.returncode, 2)
            self.assertRegex(done.stderr, r'there is no GPU 63; EGL lists \d+ device')
            done = run(program, *arguments, '--backend', 'gl', '--gpu', 'two')
            self.assertEqual(done.returncode, 2)
            self.assertIn('GPU "two" is neither auto nor in [0, 63]', done.stderr)

    def test_a_gpu_is_for_local_rendering(self):
        done = run(SPLATCTL, 'render', '--volume', 'phantom', '--out', '-', '--gpu', '0')
        self.assertEqual(done.returncode, 2)
        self.assertIn("need --local", done.stderr)


class Daemon(unittest.TestCase):
    def ready(self, machine, *options):
        """Returns the answer of /readyz, and the log."""
        environment = {**os.environ, **MESA, **MACHINES[machine][0]}
        with subprocess.Popen([SPLATD, '--listen', '127.0.0.1:0', *options], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, env=environment) as daemon:
            try:
                line = daemon.stdout.readline()
                if not line:
                    self.fail(daemon.stderr.read())
                url = re.fullmatch(r'splatd: listening on (http://\S+/)\S*\n', line)[1]
                opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
                with opener.open(url + 'readyz', timeout=60) as answer:
                    ready = json.load(answer)
            finally:
                daemon.terminate()
            return ready, daemon.stderr.read()

    def test_auto_takes_the_cpu_and_says_so(self):
        for machine in MACHINES:
            with self.subTest(machine):
                ready, log = self.ready(machine)
                self.assertEqual(ready['backend'], 'cpu')
                self.assertRegex(log, 'backend cpu renders on ')
                self.assertEqual(bool(ready['refused']), 'backend gl does not start: ' in log)

    @unittest.skipUnless(builds_gl() and has_software(), 'no software GL')
    def test_software_gl_renders_where_it_is_named(self):
        ready, log = self.ready('software', '--backend', 'gl-software')
        self.assertEqual(ready['backend'], 'gl-software')
        self.assertIn('backend gl-software renders on ' + ready['device'], log)


if __name__ == '__main__':
    unittest.main()
