#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The lint rules find what they should: each case breaks one rule in a small tree of its own."""
import os
import tempfile
import types
import unittest

import lint


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

    def test_rooms(self):
        wrong = {
            'renderer/base/a.c': 'volume/volume.h',
            'renderer/classify/a.c': 'splat/ewa.h',
            'renderer/splat/a.c': 'tile/bin.h',
            'renderer/tile/a.c': 'backend/backend.h',
            'renderer/backend/cpu/a.c': 'backend/null/null.h',
            'renderer/include/sp/a.h': 'base/arena.h',
            'renderer/volume/a.c': '../base/arena.h',
            'renderer/frame/a.c': 'protocol/json.h',
            'protocol/a.c': 'server/config.h',
            'protocol/b.c': 'classify/transfer.h',
            'clients/cli/a.c': 'http/router.h',
            'server/session/a.c': 'http/router.h',
            'server/render/a.c': 'http/listener.h',
            'server/http/a.c': 'classify/transfer.h',
        }
        for path, name in wrong.items():
            with self.subTest(path):
                self.assertEqual(len(self.findings('rooms', {path: f'#include "{name}"\n'})), 1)
        right = {
            'renderer/backend/cpu/a.c': 'backend/cpu/kernels.h',
            'renderer/backend/cpu/b.c': 'backend/backend.h',
            'renderer/tile/a.c': 'splat/ewa.h',
            'protocol/a.c': 'sp/view.h',
            'clients/cli/a.c': 'protocol/json.h',
            'server/http/a.c': 'session/session.h',
            'server/render/a.c': 'sp/renderer.h',
            'server/main.c': 'http/listener.h',
        }
        for path, name in right.items():
            with self.subTest(path):
                self.assertEqual(self.findings('rooms', {path: f'#include "{name}"\n'}), [])

    def test_clocks(self):
        for line in ('clock_gettime(CLOCK_REALTIME, &t);', 'time(NULL);', 'gettimeofday(&t, 0);', 'pthread_cond_timedwait(&c, &m, &t);'):
            with self.subTest(line):
                self.assertEqual(len(self.findings('clocks', {'server/http/a.c': line})), 1)
        self.assertEqual(self.findings('clocks', {'server/ops/log.c': 'clock_gettime(CLOCK_REALTIME, &t);'}), [])
        self.assertEqual(self.findings('clocks', {'server/http/a.c': 'clock_gettime(CLOCK_MONOTONIC, &t); run_time(0);'}), [])
        self.assertEqual(self.findings('clocks', {'server/http/a.c': 'pthread_cond_timedwait(&c, &m, &t);',
                                                  'server/http/b.c': 'pthread_condattr_setclock(&a, CLOCK_MONOTONIC);'}), [])

    def test_third_party(self):
        self.assertEqual(len(self.findings('third-party', {'server/session/a.c': '#include <microhttpd.h>'})), 1)
        self.assertEqual(len(self.findings('third-party', {'protocol/view.c': '#include <jansson.h>'})), 1)
        self.assertEqual(len(self.findings('third-party', {'server/http/a.cpp': ''})), 1)
        self.assertEqual(self.findings('third-party', {'protocol/json.c': '#include <jansson.h>'}), [])

    def test_headers(self):
        self.assertEqual(len(self.findings('headers', {'renderer/include/sp/a.h': 'size_t f(void);\n'})), 1)
        self.assertEqual(self.findings('headers', {'renderer/include/sp/a.h': '#include <stddef.h>\nsize_t f(void);\n'}), [])

    def test_style(self):
        spdx = '/* SPDX-License-Identifier: Apache-2.0 */\n'
        self.assertEqual(len(self.findings('style', {'protocol/a.c': 'int x;\n'})), 1)
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + 'x' * 101})), 1)
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + 'int x; \n'})), 1)
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + '/* ---- x ---- */\n'})), 1)
        self.assertEqual(len(self.findings('style', {'protocol/a.c': spdx + '\n' * 800})), 1)
        self.assertEqual(len(self.findings('style', {'clients/web/core/a.js': '// SPDX-License-Identifier: Apache-2.0\n'
                                                     "import { x } from '../app/x.js';\n"})), 1)

    def test_words(self):
        self.assertEqual(len(self.findings('words', {'protocol/a.c': '/* TO' 'DO */'})), 1)
        self.assertEqual(len(self.findings('words', {'tests/package-lock.json': '"resolved": "https://example"'})), 1)


if __name__ == '__main__':
    unittest.main()
