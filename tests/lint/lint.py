#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The rules of the house.

  lint.py RULE --source DIR [--build DIR] [--cc CC]

Rules: rooms (who may include whom), third-party (a library's headers have one room), globals (no mutable
global state), headers (public headers compile alone), style (SPDX, lengths), format (clang-format), words
(nothing unfinished), clocks (nothing waits for a time of day, which may jump). Prints one line a finding, `FILE:LINE: what`; exit status 0 clean, 1 findings, 77 skipped.
"""
import argparse
import os
import re
import shutil
import subprocess
import sys

# What tells people the time, and judges the dates of certificates.
TIME_OF_DAY = {'server/ops/log.c', 'server/http/tls_keys.c'}

# Rule 1: inside the renderer, a room includes itself and those named here ("sp" = the public headers).
RENDERER = {
    'base': {'sp'},
    'volume': {'sp', 'base'},
    'frame': {'sp', 'base'},
    'encode': {'sp', 'base', 'frame'},
    'import': {'sp', 'base', 'volume'},
    'classify': {'sp', 'base', 'volume', 'frame'},
    'splat': {'sp', 'base', 'volume', 'frame', 'classify'},
    'tile': {'sp', 'base', 'volume', 'frame', 'classify', 'splat'},
    'backend': {'sp', 'base', 'volume', 'frame', 'classify', 'splat', 'tile', 'backend'},
    '.': {'sp', 'base', 'volume', 'frame', 'classify', 'splat', 'tile', 'backend'},
}
# Rule 3: inside the server.
SERVER = {
    'session': {'session', 'config'},
    'render': {'render', 'session', 'config'},
    'store': {'store', 'config'},
    'jobs': {'jobs', 'render', 'store', 'config'},
    'http': {'http', 'session', 'render', 'store', 'jobs', 'config'},
    '.': {'http', 'session', 'render', 'store', 'jobs', 'config'},
}
# Rule 4: header pattern → the only places that may include it.
THIRD_PARTY = [
    (r'(EGL|GLES\d|GL|epoxy)/', ['renderer/backend/gl/']),
    (r'\w*mmintrin\.h|immintrin\.h|arm_neon\.h', ['renderer/base/', 'renderer/backend/cpu/']),
    (r'microhttpd', ['server/http/']),
    (r'wslay', ['server/http/']),
    (r'gnutls/', ['server/http/']),
    (r'jansson', ['protocol/json.c', 'renderer/import/raw.c']),
    (r'OpenImageIO', ['renderer/import/', 'renderer/encode/']),
    (r'teem|nrrd|air\.h|biff', ['renderer/import/']),
    (r'expat', ['renderer/import/']),
    (r'turbojpeg|jpeglib', ['renderer/encode/']),
    (r'webp/', ['renderer/encode/']),
    (r'vpx/|x264', ['renderer/encode/', 'tests/unit/encode/', 'tests/unit/server/']),
    (r'zlib|libdeflate|png\.h', ['renderer/import/', 'renderer/encode/', 'server/http/gzip.c']),
    (r'sqlite3', ['server/store/']),
    (r'archive(_entry)?\.h', ['server/paths/archive.c']),
    (r'(ebml|matroska)/', ['server/paths/webm_bridge.cpp']),
    (r'systemd/', ['server/ops/service.c']),
    (r'xxhash', ['server/render/fingerprint.c']),
    (r'curl/', ['clients/cli/']),
]
# Rule 5: file-scope variables that may change after start; `parsing` is each thread's own.
MUTABLE = {'log_state', 'cpu_mask', 'parsing'}

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
SOURCE = ('.c', '.h', '.cpp')
CODE = SOURCE + ('.py', '.mjs', '.js', '.sh', '.css', '.html', '.cmake')
LINES_MAX, COLUMNS_MAX = 800, 100


def files(source, suffixes):
    """Paths below `source`, relative, of the project's own text files."""
    for folder, names, leaves in os.walk(source):
        names[:] = sorted(n for n in names if n not in ('build', 'node_modules', '.git', '__pycache__'))
        for leaf in sorted(leaves):
            if leaf.endswith(suffixes):
                yield os.path.relpath(os.path.join(folder, leaf), source)


def lines(source, path):
    with open(os.path.join(source, path), encoding='utf-8', errors='replace') as f:
        return f.read().split('\n')


def includes(source, path):
    for number, line in enumerate(lines(source, path), 1):
        hit = INCLUDE.match(line)
        if hit:
            yield number, hit.group(1) == '"', hit.group(2)


def room(path, top):
    """The room of a path below `top`: its first folder, or "." for files that lie in `top` itself."""
    rest = path[len(top) + 1:].split('/')
    return rest[0] if len(rest) > 1 else '.'


def rooms(o):
    for path in files(o.source, SOURCE):
        if path.startswith('tests/'):
            continue
        folder = os.path.dirname(path)
        for number, own, name in includes(o.source, path):
            if not own:
                continue
            problem = check_include(path, folder, name, o.source)
            if problem:
                yield f'{path}:{number}: {problem}'


def check_include(path, folder, name, source):
    """What is wrong with `path` including "name", or None."""
    if '..' in name:
        return f'"{name}" climbs out of its folder; include it from the room\'s root'
    first = name.split('/')[0] if '/' in name else None
    if path.startswith('renderer/include/'):
        return None if first == 'sp' else f'a public header includes "{name}", which is private'
    if path.startswith('renderer/'):
        here = room(path, 'renderer')
        if here not in RENDERER:
            return f'renderer/{here} is not a room that lint.py knows'
        if first is None or first == here:
            target = here
        else:
            target = first
        if target == here:
            pass
        elif target not in RENDERER[here]:
            return f'renderer/{here} may not include "{name}"'
        if path.startswith('renderer/backend/') and first == 'backend' and name.count('/') > 1:
            mine = path.split('/')[2]
            if name.split('/')[1] != mine:
                return f'backend {mine} includes another backend: "{name}"'
        return None
    if path.startswith('protocol/'):
        return None if first in (None, 'sp', 'protocol') else f'protocol may include sp/ alone, not "{name}"'
    if path.startswith('clients/'):
        if first in (None, 'sp', 'protocol') or os.path.exists(os.path.join(source, folder, name)):
            return None
        return f'a client may include sp/ and protocol/, not "{name}"'
    if path.startswith('server/'):
        here = room(path, 'server')
        if first in ('sp', 'protocol'):
            return None
        target = first if first else ('config' if name == 'config.h' else here)
        allowed = SERVER.get(here)
        if allowed is None:
            return f'server/{here} is not a room that lint.py knows'
        if target == here or target in allowed or first == here:
            return None
        return f'server/{here} may not include "{name}"'
    return None


def third_party(o):
    for path in files(o.source, SOURCE):
        if path.startswith('tests/'):
            continue
        for number, own, name in includes(o.source, path):
            if own and os.path.exists(os.path.join(o.source, os.path.dirname(path), name)):
                continue
            for pattern, places in THIRD_PARTY:
                if re.match(pattern, name) and not path.startswith(tuple(places)):
                    yield f'{path}:{number}: <{name}> belongs to {" or ".join(places)}'
        if path.endswith('.cpp') and not path.endswith('_bridge.cpp'):
            yield f'{path}:1: C++ is for bridges alone (*_bridge.cpp)'


def globals_(o):
    """Symbols in writable sections of the renderer's, protocol's and server's objects; and backends' #ifdefs."""
    for path in files(o.source, SOURCE):
        if path.startswith('renderer/backend/registry.c') or path.startswith('tests/'):
            continue
        for number, line in enumerate(lines(o.source, path), 1):
            if re.match(r'\s*#\s*(el)?if.*\bSPLATD?_(WITH_|HAVE_)?(BACKEND|GL|CPU_BACKEND)', line):
                yield f'{path}:{number}: #if of a backend outside the registry'
    archives = [os.path.join(f, n) for f, _, ns in os.walk(o.build) for n in ns
                if re.fullmatch(r'libsplat(_protocol|_server)?\.a', n)]
    if not archives:
        print(f'skipped: no libsplat*.a below {o.build}; build first')
        sys.exit(77)
    for archive in archives:
        out = subprocess.run(['nm', '-A', archive], capture_output=True, text=True, check=True).stdout
        for line in out.splitlines():
            hit = re.match(r'.*?:([^:]+):\S*\s+([bBdDsS])\s+(\S+)$', line)
            if not hit:
                continue
            name = re.sub(r'\.\d+$', '', hit.group(3))
            if name.startswith(('__', '.L', '_ZZ', '.data', '.bss', 'asan.', 'tsan.', 'llvm')) or name in MUTABLE:
                continue
            if is_relocated_constant(archive, hit.group(1), hit.group(3)):
                continue
            yield f'{os.path.basename(archive)}:{hit.group(1)}: mutable global `{name}`'


def is_relocated_constant(archive, member, symbol):
    """Constant tables that hold addresses lie in .data.rel.ro: written by the loader, then read-only."""
    out = subprocess.run(['objdump', '-t', archive], capture_output=True, text=True, check=False).stdout
    inside = False
    for line in out.splitlines():
        if line.startswith(member + ':'):
            inside = True
        elif inside and 'file format' in line:
            inside = False
        if inside and line.split()[-1:] == [symbol] and '.data.rel.ro' in line:
            return True
    return False


def headers(o):
    for path in files(os.path.join(o.source, 'renderer/include'), ('.h',)):
        yield from compiles(o, f'renderer/include/{path}', [])
    for path in files(os.path.join(o.source, 'protocol'), ('.h',)):
        yield from compiles(o, f'protocol/{path}', ['-I' + o.source])


def compiles(o, path, flags):
    command = [o.cc, '-std=c17', '-Wall', '-Wextra', '-Werror', '-fsyntax-only', '-x', 'c', *flags,
               '-I' + os.path.join(o.source, 'renderer/include'), os.path.join(o.source, path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        yield f'{path}:1: does not compile alone: {(done.stderr.splitlines() or [""])[0]}'


def style(o):
    for path in files(o.source, CODE):
        text = lines(o.source, path)
        if len(text) > LINES_MAX:
            yield f'{path}:{LINES_MAX}: {len(text)} lines, more than {LINES_MAX}: probably two rooms'
        if not any('SPDX-License-Identifier: Apache-2.0' in line for line in text[:3]):
            yield f'{path}:1: no SPDX line'
        for number, line in enumerate(text, 1):
            if path.endswith(SOURCE) and len(line) > COLUMNS_MAX:
                yield f'{path}:{number}: {len(line)} columns, more than {COLUMNS_MAX}'
            if re.match(r'\s*(/\*|//|#|\*) ?[-=*#]{4,}', line):
                yield f'{path}:{number}: a banner'
            if line != line.rstrip():
                yield f'{path}:{number}: space at the end of the line'
    main = lines(o.source, 'server/main.c')
    if len(main) > 150:
        yield f'server/main.c:150: {len(main)} lines; main wires, in at most 150'
    for path in files(os.path.join(o.source, 'clients/web/core'), ('.js', '.mjs')):
        for number, line in enumerate(lines(o.source, 'clients/web/core/' + path), 1):
            if re.search(r'(import|from)\s*\(?[\'"][^\'"]*app/', line):
                yield f'clients/web/core/{path}:{number}: core/ imports app/'


def clocks(o):
    for room in ('renderer', 'server', 'protocol', 'clients'):
        for path in files(os.path.join(o.source, room), ('.c', '.h', '.cpp')):
            path = f'{room}/{path}'
            text = lines(o.source, path)
            for number, line in enumerate(text, 1):
                if path not in TIME_OF_DAY and re.search(r'\bCLOCK_REALTIME|\bgettimeofday *\(|\b(time|timespec_get) *\( *(NULL|0|&)', line):
                    yield f'{path}:{number}: the time of day: it jumps'
                if re.search(r'\b(pthread_cond_timedwait|sem_timedwait|pthread_mutex_timedlock) *\(', line):
                    folder = os.path.dirname(os.path.join(o.source, path))
                    beside = ''.join(open(os.path.join(folder, name), encoding='utf-8').read()
                                     for name in os.listdir(folder) if name.endswith('.c'))
                    if 'pthread_condattr_setclock' not in beside:
                        yield f'{path}:{number}: waits until a time of day: no pthread_condattr_setclock() in its folder'


def format_(o):
    tool = shutil.which('clang-format-14')
    if not tool:
        print('skipped: no clang-format-14 (Debian package clang-format-14)')
        sys.exit(77)
    for path in files(o.source, SOURCE):
        done = subprocess.run([tool, '--dry-run', '--Werror', os.path.join(o.source, path)],
                              capture_output=True, text=True, check=False)
        if done.returncode:
            hit = re.search(r':(\d+):\d+:', done.stderr)
            yield f'{path}:{hit.group(1) if hit else 1}: not as clang-format-14 -i leaves it'


def words(o):
    unfinished = re.compile(r'\b(TO' r'DO|FIX' r'ME|X' r'XX|HA' r'CK|not impl' r'emented|unimpl' r'emented)\b')
    for path in files(o.source, CODE + ('.md', '.txt', '.yaml', '.json')):
        if path == 'tests/package-lock.json':
            for number, line in enumerate(lines(o.source, path), 1):
                if '"resolved"' in line:
                    yield f'{path}:{number}: names a registry host'
            continue
        for number, line in enumerate(lines(o.source, path), 1):
            if unfinished.search(line):
                yield f'{path}:{number}: reads as unfinished'


RULES = {'rooms': rooms, 'third-party': third_party, 'globals': globals_, 'headers': headers, 'style': style,
         'format': format_, 'words': words, 'clocks': clocks}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('rule', choices=RULES)
    parser.add_argument('--source', default=os.path.abspath(os.path.join(os.path.dirname(__file__), '..', '..')))
    parser.add_argument('--build', default='build/release')
    parser.add_argument('--cc', default='cc')
    options = parser.parse_args()
    findings = list(RULES[options.rule](options))
    for finding in findings:
        print(finding)
    print(f'{options.rule}: {len(findings)} findings')
    return 1 if findings else 0


if __name__ == '__main__':
    sys.exit(main())
