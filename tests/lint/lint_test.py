#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of lint.py: each case breaks one rule in a small tree of its own."""
import os
import re
import shutil
import subprocess
import tempfile
import types
import unittest

import lint

TOP = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..')
TYPESCRIPT = os.path.join(TOP, 'tests', 'node_modules', 'typescript')


with open(os.path.join(TOP, lint.CONTRIBUTING), encoding='utf-8') as page:
    RULES = page.read()


class Tree(unittest.TestCase):
    def findings(self, rule, files):
        with tempfile.TemporaryDirectory() as top:
            for path, text in {'server/main.c': '/* SPDX-License-Identifier: Apache-2.0 */', **files}.items():
                full = os.path.join(top, path)
                os.makedirs(os.path.dirname(full), exist_ok=True)
                with open(full, 'w', encoding='utf-8') as f:
                    f.write(text)
            options = types.SimpleNamespace(source=top, build=top, cc='cc')
            return list(lint.RULES[rule](options))

    def include(self, path, name, *others):
        """Findings of `layers` for one include; `others` are empty files that exist."""
        return self.findings('layers', {**dict.fromkeys(others, ''), path: f'#include "{name}"\n', lint.CONTRIBUTING: RULES})

    def test_layers_right(self):
        for path, name, target in [
                ('renderer/base/a.c', 'sp/status.h', 'renderer/include/sp/status.h'),
                ('renderer/draw/footprints/a.c', 'splat/ewa.h', 'renderer/splat/ewa.h'),
                ('renderer/draw/postconv/a.c', 'splat/ewa.h', 'renderer/splat/ewa.h'),
                ('renderer/backend/cpu/a.c', 'backend/cpu/kernels.h', 'renderer/backend/cpu/kernels.h'),
                ('renderer/backend/cpu/a.c', 'backend/backend.h', 'renderer/backend/backend.h'),
                ('renderer/backend/registry.c', 'backend/cpu/cpu.h', 'renderer/backend/cpu/cpu.h'),
                ('renderer/renderer.c', 'backend/backend.h', 'renderer/backend/backend.h'),
                ('protocol/a.c', 'sp/view.h', 'renderer/include/sp/view.h'),
                ('protocol/a.c', 'protocol/json.h', 'protocol/json.h'),
                ('clients/cli/a.c', 'protocol/json.h', 'protocol/json.h'),
                ('clients/cli/a.c', 'cli/http.h', 'clients/cli/http.h'),
                ('server/session/a.c', 'common/clock.h', 'server/common/clock.h'),
                ('server/schedule/a.c', 'session/session.h', 'server/session/session.h'),
                ('server/http/a.c', 'paths/paths.h', 'server/paths/paths.h'),
                ('server/render/a.c', 'sp/renderer.h', 'renderer/include/sp/renderer.h'),
                ('server/main.c', 'http/listener.h', 'server/http/listener.h'),
                ('tests/unit/draw/footprints/a.c', 'draw/footprints/bin.h', 'renderer/draw/footprints/bin.h')]:
            with self.subTest(path=path, name=name):
                self.assertEqual(self.include(path, name, target), [])

    def test_layers_wrong(self):
        for path, name, target in [
                ('renderer/base/a.c', 'data/volume/volume.h', 'renderer/data/volume/volume.h'),
                ('renderer/data/volume/a.c', 'frame/frame.h', 'renderer/frame/frame.h'),
                ('renderer/classify/a.c', 'splat/ewa.h', 'renderer/splat/ewa.h'),
                ('renderer/splat/a.c', 'draw/footprints/bin.h', 'renderer/draw/footprints/bin.h'),
                ('renderer/draw/postconv/a.c', 'draw/footprints/bin.h', 'renderer/draw/footprints/bin.h'),
                ('renderer/draw/footprints/a.c', 'draw/postconv/postconv.h', 'renderer/draw/postconv/postconv.h'),
                ('renderer/draw/footprints/a.c', 'backend/backend.h', 'renderer/backend/backend.h'),
                ('renderer/data/import/a.c', 'classify/transfer.h', 'renderer/classify/transfer.h'),
                ('renderer/encode/a.c', 'draw/footprints/bin.h', 'renderer/draw/footprints/bin.h'),
                ('renderer/backend/cpu/a.c', 'backend/null/null.h', 'renderer/backend/null/null.h'),
                ('renderer/news/a.c', 'base/arena.h', 'renderer/base/arena.h'),
                ('server/ops/a.c', 'config/config.h', 'server/config/config.h'),
                ('server/store/a.c', 'session/session.h', 'server/session/session.h'),
                ('server/session/a.c', 'schedule/pick.h', 'server/schedule/pick.h'),
                ('server/schedule/a.c', 'render/render.h', 'server/render/render.h'),
                ('server/render/a.c', 'http/listener.h', 'server/http/listener.h'),
                ('server/paths/a.c', 'http/router.h', 'server/http/router.h'),
                ('server/http/a.c', 'daemon/daemon.h', 'server/daemon/daemon.h')]:
            with self.subTest(path=path, name=name):
                self.assertEqual(len(self.include(path, name, target)), 1)

    def test_layers_between_parts(self):
        for path, name in [('renderer/frame/a.c', 'protocol/json.h'), ('protocol/a.c', 'server/http/router.h'),
                           ('protocol/b.c', 'classify/transfer.h'), ('clients/cli/a.c', 'server/http/router.h'),
                           ('clients/cli/a.c', 'http/router.h'), ('server/http/a.c', 'classify/transfer.h'),
                           ('server/http/a.c', 'clients/cli/http.h'), ('server/http/a.c', 'tests/support/image.h'),
                           ('renderer/include/sp/a.h', 'base/arena.h')]:
            with self.subTest(path=path, name=name):
                self.assertEqual(len(self.include(path, name, 'protocol/json.h', 'server/http/router.h', 'clients/cli/http.h',
                                                  'renderer/classify/transfer.h', 'renderer/base/arena.h',
                                                  'tests/support/image.h')), 1)
        self.assertEqual(len(self.include('protocol/a.c', 'tests/support/image.h', 'tests/support/image.h')), 1)

    def test_layers_written_without_folder(self):
        self.assertEqual(len(self.include('server/http/a.c', 'router.h', 'server/http/router.h')), 1)
        self.assertEqual(len(self.include('renderer/data/volume/a.c', '../base/arena.h', 'renderer/base/arena.h')), 1)
        self.assertEqual(len(self.include('tests/unit/a.c', 'fixture.h', 'tests/unit/fixture.h')), 1)

    def test_cycles(self):
        line = '#include "{}"\n'.format
        self.assertEqual(self.findings('cycles', {
            'server/session/a.h': line('session/b.h'), 'server/session/b.h': '',
            'server/session/a.c': line('session/a.h') + line('session/a_private.h'),
            'server/session/a_private.h': line('session/a.h')}), [])
        self.assertEqual(len(self.findings('cycles', {
            'server/session/a.h': '', 'server/session/b.h': '',
            'server/session/a.c': line('session/b.h'), 'server/session/b.c': line('session/a.h')})), 1)
        found = self.findings('cycles', {
            'server/http/a.c': line('ops/a.h'), 'server/ops/b.c': line('store/a.h'), 'server/store/b.c': line('http/a.h'),
            'server/http/a.h': '', 'server/ops/a.h': '', 'server/store/a.h': ''})
        self.assertEqual(len(found), 1)
        self.assertIn('server/http -> server/ops -> server/store -> server/http', found[0])

    def test_globals_without_a_build_is_skipped(self):
        with self.assertRaises(SystemExit) as skipped:
            self.findings('globals', {'protocol/a.c': ''})
        self.assertEqual(skipped.exception.code, 77)

    def test_globals(self):
        with tempfile.TemporaryDirectory() as top:
            source = os.path.join(top, 'a.c')
            with open(source, 'w', encoding='utf-8') as f:
                f.write('int counter; static int hidden = 1; const int fixed = 2; static const char *const table[] = { "x" };\n'
                        'int log_state; const void *use(void) { return hidden++ ? table : 0; }\n')
            subprocess.run(['cc', '-fPIC', '-c', source, '-o', os.path.join(top, 'a.o')], check=True)
            subprocess.run(['ar', 'cr', os.path.join(top, 'libsplat.a'), os.path.join(top, 'a.o')], check=True)
            found = list(lint.RULES['globals'](types.SimpleNamespace(source=top, build=top, cc='cc')))
        self.assertEqual([re.search('`(.*)`', line).group(1) for line in found], ['counter', 'hidden'])

    def test_clocks(self):
        for line in ('clock_gettime(CLOCK_REALTIME, &t);', 'time(NULL);', 'gettimeofday(&t, 0);', 'pthread_cond_timedwait(&c, &m, &t);'):
            with self.subTest(line):
                self.assertEqual(len(self.findings('clocks', {'server/http/a.c': line})), 1)
        self.assertEqual(self.findings('clocks', {'server/common/clock.h': 'clock_gettime(CLOCK_REALTIME, &t);'}), [])
        self.assertEqual(self.findings('clocks', {'server/http/a.c': 'clock_gettime(CLOCK_MONOTONIC, &t); run_time(0);'}), [])
        self.assertEqual(self.findings('clocks', {'server/http/a.c': 'pthread_cond_timedwait(&c, &m, &t);',
                                                  'server/http/b.c': 'srv_clock_cond_init(&c);'}), [])

    def test_third_party(self):
        for path, text in {'server/session/a.c': '#include <microhttpd.h>', 'protocol/view.c': '#include <newlib.h>',
                           'server/paths/a.c': '#include <zlib.h>', 'renderer/backend/cpu/a.c': '#include <immintrin.h>',
                           'renderer/draw/a.c': 'a = _mm256_add_ps(b, c);', 'renderer/splat/a.h': '__m128 a;',
                           'server/http/a.cpp': ''}.items():
            with self.subTest(path):
                self.assertEqual(len(self.findings('third-party', {path: text})), 1)
        for path, text in {'protocol/json.c': '#include <jansson.h>', 'server/http/a.c': '#include <sys/socket.h>',
                           'renderer/encode/a_bridge.cpp': '#include <vector>', 'renderer/base/wide.h': '__m128 a;', 'tests/unit/a.c': '#include <newlib.h>'}.items():
            with self.subTest(path):
                self.assertEqual(self.findings('third-party', {path: text}), [])

    def test_headers(self):
        self.assertEqual(len(self.findings('headers', {'renderer/include/sp/a.h': 'size_t f(void);\n'})), 1)
        self.assertEqual(len(self.findings('headers', {'protocol/a.h': 'size_t f(void);\n'})), 1)
        self.assertEqual(self.findings('headers', {'renderer/include/sp/a.h': '#include <stddef.h>\nsize_t f(void);\n'}), [])

    def test_headers_cpp(self):
        self.assertEqual(len(self.findings('headers-cpp', {'renderer/include/sp/a.h': 'int f(int class);\n'})), 1)
        self.assertEqual(self.findings('headers-cpp', {'renderer/include/sp/a.h': 'int f(int kind);\n'}), [])

    def test_length(self):
        for path in ('protocol/a.c', 'tests/web/a.test.mjs', 'deploy/a.sh'):
            with self.subTest(path):
                self.assertEqual(len(self.findings('length', {path: '\n' * 601})), 1)
                self.assertEqual(self.findings('length', {path: '\n' * 600}), [])

    def test_length_of_functions(self):
        body = '    f();\n' * 64
        for path, text in [('protocol/a.c', 'void f(int a,\n       int b) {\n' + body + '}\n'),
                           ('clients/web/app/a.js', 'export function install(app) {\n' + body + '}\n'),
                           ('clients/web/app/a.js', 'const f = (app) => {\n' + body + '};\n')]:
            with self.subTest(text[:20]):
                self.assertEqual(len(self.findings('length', {path: text})), 1)
                self.assertEqual(self.findings('length', {path: text.replace(body, '    f();\n' * 60)}), [])
        for text in ('void f(void);\nstruct s {\n' + body + '};\n', 'class F {\n' + body + '}\n', 'static int x[] = {\n' + body + '};\n'):
            with self.subTest(text[:20]):
                self.assertEqual(self.findings('length', {'protocol/a.c': text}), [])

    def test_unused(self):
        page = {'clients/web/core/a.js': 'export function f() {}\n', 'clients/web/app/b.js': "import { f } from '../core/a.js';\n"
                "make('p', { class: 'used', id: `row-${f()}` });\n", 'clients/web/a.css': '/* .old */ .used, #row-1 { color: red; }\n'}
        self.assertEqual(self.findings('unused', page), [])
        for path, text in [('clients/web/core/a.js', 'export const g = 1;\n'), ('clients/web/a.css', '.other { color: red; }\n')]:
            with self.subTest(text):
                self.assertEqual(len(self.findings('unused', {**page, path: page[path] + text})), 1)
        tested = {**page, 'clients/web/core/a.js': 'export const g = 1;\n', 'tests/web/core/a.test.mjs': 'g;\n'}
        self.assertEqual(self.findings('unused', tested), [])

    def test_glossary(self):
        for path, text in [('server/session/a.c', 'struct srv_fl' 'ight *f;'), ('server/http/a.c', '/* A ro' 'om for it. */'),
                           ('renderer/README.md', 'thirty frames a ' 'second'), ('server/render/a.h', '/* the still ' 'lane */'),
                           ('clients/web/a.js', 'no' 'body waits'), ('renderer/draw/footprints/a.c', '/* one pic' 'ture */'),
                           ('server/schedule/a.c', 'int wi' 'sh_count;'), ('server/render/a.c', '/* bytes a ' 'pixel */'),
                           ('server/http/a.c', 'int la' 'ne = 1;'), ('renderer/splat/a.c', 'static float fi' 'nd_width(float x) {'),
                           ('renderer/base/a.h', 'void sp_budget_ta' 'ke(int bytes);'), ('protocol/a.h', 'enum { BYTES_MO' 'ST = 4 };'),
                            ('server/config/a.c', '/* two sti' 'lls */')]:
            with self.subTest(text):
                self.assertNotEqual(self.findings('glossary', {path: text}), [])
        for path, text in [('renderer/base/wide.h', '/* SIMD lanes */'), ('server/a.md', 'frames in fl' 'ight, in_fl' 'ight'),
                           ('clients/web/a.js', 'save the picture'), ('renderer/draw/footprints/a.c', '/* frames per second, headroom */'),
                           ('server/http/a.c', 'set(json, "lanes", info->lanes)'),
                           ('server/http/a.c', 'static bool find_route(int at) {'), ('server/http/a.c', 'srv_finding(mistake(1));')]:
            with self.subTest(text):
                self.assertEqual(self.findings('glossary', {path: text}), [])

    def test_style(self):
        spdx = '/* SPDX-License-Identifier: Apache-2.0 */\n'
        self.assertEqual(len(self.findings('style', {'protocol/a.c': 'int x;\n'})), 1)
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + 'x' * 101})), 1)
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + 'int x; \n'})), 1)
        compared = spdx + 'if (strcmp(err->place, "/id") == 0)\n'
        self.assertEqual(len(self.findings('style', {'protocol/a.c': compared})), 1)
        self.assertEqual(self.findings('style', {'tests/a.c': compared}), [])
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + '/* ---- x ---- */\n'})), 1)
        self.assertEqual(len(self.findings('style', {'clients/web/core/a.js': '// SPDX-License-Identifier: Apache-2.0\n'
                                                     "import { x } from '../app/x.js';\n"})), 1)

    @unittest.skipUnless(shutil.which('clang-format-14'), 'no clang-format-14')
    def test_format(self):
        style = {'.clang-format': 'BasedOnStyle: LLVM\n', 'protocol/b.c': 'int y;\n'}
        found = self.findings('format', {**style, 'protocol/a.c': 'int x;\nint   y;\nint   z;\n'})
        self.assertEqual(found, ['protocol/a.c:2: run clang-format-14 -i on it'])
        self.assertEqual(self.findings('format', style), [])

    def test_words(self):
        self.assertEqual(len(self.findings('words', {'protocol/a.c': '/* TO' 'DO */'})), 1)
        self.assertEqual(len(self.findings('words', {'tests/package-lock.json': '"resolved": "https://example"'})), 1)

    @unittest.skipUnless(shutil.which('node') and os.path.isdir(TYPESCRIPT), 'no node or no tests/node_modules/typescript')
    def test_types(self):
        config = '{"compilerOptions": {"allowJs": true, "checkJs": true, "noEmit": true, "types": []}, "include": ["core"]}'
        tree = {'clients/web/tsconfig.json': config, 'clients/web/core/a.js': 'export const length = (text) => Math.abs(text);\n'}
        self.assertEqual(self.findings('types', tree), [])
        wrong = "\nlength(1).missing();\n"
        found = self.findings('types', {**tree, 'clients/web/core/a.js': tree['clients/web/core/a.js'] + wrong})
        self.assertEqual(len(found), 1)
        self.assertRegex(found[0], r'^clients/web/core/a.js:3: .*missing')


if __name__ == '__main__':
    unittest.main()
