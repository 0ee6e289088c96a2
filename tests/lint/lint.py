#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the rules of the code base. No rule has an exception list.

  lint.py RULE [--source DIR] [--build DIR] [--cc CC]

  layers       every #include "..." names its folder, and no folder includes one to its right
  cycles       no circle between folders, and none between files except a header and its own source
  third-party  a library's headers are included from one folder, and SIMD intrinsics stand in renderer/base
  headers      public headers compile alone as C
  headers-cpp  public headers compile alone as C++
  globals      no mutable global but the log sink and the CPU feature mask
  clocks       no wait depends on the time of day, which may jump
  format       C and C++ are formatted as clang-format-14 formats them
  style        SPDX line, line length, no banners, no trailing spaces
  length       files have at most 600 lines
  glossary     the words of the glossary, not the words that it replaces
  words        nothing unfinished
  types        the types in the comments of clients/web agree, as TypeScript reads them

Prints one line per finding, `FILE:LINE: what`. The exit status is 0 if there are no findings, 1 if there are, and 77 if
the rule was skipped.
"""
import argparse
import os
import re
import shutil
import subprocess
import sys

TIME_OF_DAY = 'server/common/clock.h'  # the one file that reads the time of day, for dates

# The page with the rules for folders, one per line: "PARENT: a ← {b, c ← d}". A folder may include those on its left; the name of a file means all files
# that lie loose in the parent. Every part may include "sp/" except where its entry says otherwise (SEES).
CONTRIBUTING = 'CONTRIBUTING.md'
RULE = re.compile(r'((?:renderer|server)[a-z_/]*): +(\S.*←.*|\w+(?:, \w+)*)$')
# The other parts that a part may include: "sp" is renderer/include/sp, and nothing includes server/. Tests include all.
SEES = {'sp': set(), 'renderer': {'sp'}, 'protocol': {'sp'}, 'server': {'sp', 'protocol'}, 'clients': {'sp', 'protocol'}}
# Where the compiler looks for #include "…" of a part, in this order.
ROOTS = {
    'sp': ['renderer/include'],
    'renderer': ['renderer/include', 'renderer', ''],
    'protocol': ['renderer/include', ''],
    'server': ['server', 'renderer/include', ''],
    'clients': ['renderer/include', '', 'clients'],
    'tests': ['tests', 'renderer/include', '', 'renderer', 'server', 'clients'],
}
# Names of the headers of instruction sets.
INTRINSIC = re.compile(r'\b(_mm\d*_\w+|__m(64|128|256|512)\w?|__mmask\d+)\b')
# Third-party headers: in each part that uses a library, one folder includes it.
THIRD_PARTY = [
    (r'(EGL|GLES\d|GL|epoxy)/', {'renderer/backend/gl'}),
    (r'\w*mmintrin\.h|immintrin\.h|arm_neon\.h|cpuid\.h', {'renderer/base'}),
    (r'microhttpd', {'server/http'}),
    (r'wslay', {'server/http'}),
    (r'gnutls/', {'server/http'}),
    (r'jansson', {'protocol', 'renderer/data/import'}),
    (r'assimp/', {'renderer/data/import'}),
    (r'OpenImageIO/', {'renderer/data/import', 'renderer/encode'}),
    (r'gdcm', {'renderer/data/import'}),
    (r'lz4|lzma', {'renderer/data/import'}),
    (r'expat', {'renderer/data/import'}),
    (r'blosc', {'renderer/data/import'}),
    (r'hdf5|netcdf', {'renderer/data/import'}),
    (r'tiffio', {'renderer/data/import'}),
    (r'seccomp', {'renderer/data/import'}),
    (r'turbojpeg|jpeglib', {'renderer/encode'}),
    (r'webp/', {'renderer/encode'}),
    (r'vpx/|x264', {'renderer/encode'}),
    (r'png\.h', {'renderer/encode'}),
    (r'zstd', {'renderer/data/bricks', 'renderer/data/import', 'renderer/data/export'}),
    (r'zlib', {'renderer/data/import', 'renderer/data/export'}),
    (r'libdeflate', {'server/http'}),
    (r'bzlib', {'renderer/data/import'}),
    (r'sqlite3', {'server/store'}),
    (r'archive(_entry)?\.h', {'server/paths'}),
    (r'(ebml|matroska)/', {'server/paths'}),
    (r'systemd/', {'server/ops'}),
    (r'xxhash', {'server/render'}),
    (r'curl/', {'clients/cli', 'renderer/data/import'}),
]
# What belongs to the C and C++ languages, to POSIX, to Linux or to glibc.
SYSTEM = re.compile(
    r'(assert|complex|ctype|errno|fenv|float|inttypes|iconv|iso646|limits|locale|math|setjmp|signal|stdalign|stdarg|stdatomic|'
    r'stdbool|stddef|stdint|stdio|stdlib|stdnoreturn|string|strings|tgmath|threads|time|uchar|wchar|wctype|'
    r'dirent|dlfcn|endian|byteswap|fcntl|fnmatch|ftw|getopt|glob|grp|libgen|link|malloc|netdb|poll|pthread|pwd|regex|sched|'
    r'semaphore|spawn|syslog|termios|ucontext|unistd|(sys|net|netinet|arpa|linux|asm)/\w+)\.h$|[a-z_]+$')
# Variables of file scope that may change after start: the log sink, the CPU feature mask, and one pointer per thread.
MUTABLE = {'log_state', 'cpu_mask', 'parsing'}

# Programs branch on the code of an error (sp/status.h).
ERROR_CODE = r'(protocol|server|clients/cli)/.*\.c$'
ERROR_COMPARED = re.compile(r'\bstr(n?cmp|n?casecmp|str)\([^;]*\b(\w*err|why|error)(->|\.)(place|text)\b')

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
SOURCE = ('.c', '.h', '.cpp')
CODE = SOURCE + ('.py', '.mjs', '.js', '.sh', '.css', '.html', '.cmake')
LINES_MAX, FUNCTION_MAX, COLUMNS_MAX = 600, 65, 100
# Old words, where they apply (a pattern for the start of the path, "" = everywhere), and what to write instead. The
# brackets keep a pattern from matching itself.
C_CODE = r'(renderer|protocol|server|clients/cli|tests/(unit|conformance|kernels|support|fuzz))/'
SERVER_CODE = r'(server|protocol|clients|deploy|tests/(unit/server|integration|web|protocol))/'
COUNTED = (r'bytes?|bits?|megabits?|[KMG]i?B|[kMG]bit|frames?|images?|pictures?|requests?|messages?|events?|changes?|views?|'
           r'times|once|twice|one|two|three|many|\d+')
PER = (r'second|minute|hour|day|frame|thread|voxel|pixel|image|picture|connection|client|session|tile|volume|token|'
       r'worker|core|layer|sheet|request|step|row|line|folder|instruction set|file')
GLOSSARY = [
    (r'\b[r]ooms?\b|_[r]oom\b|\b[r]oom_', '', 'folder, quota or capacity'),
    (r'\b[w]ish(es|ed)?\b|_[w]ish(es)?\b|\b[w]ish_', '', 'frame request'),
    (r'_[c]laims?\b|\b[c]laim_|\b[c]laims?\b', r'(server/(session|schedule|render)|tests/unit/server)/', 'candidate'),
    (r'\b[s]rv_[t]urn', '', 'schedule'),
    (r'\b[p]atience\b|_[p]atience|[p]atience_', '', 'starvation limit'),
    (r'\b[s]rv_(share|pace)', '', 'srv_fair_*, srv_quality_*'),
    (r'\b[s]p_(brick|surface)_window|\b[w]indow_bytes|\b[s]rv_shown|\b[s]p_shown', '', 'subvolume, surface samples; visible, drawn or displayed'),
    (r'\b[s]rv_flow|[s]rv_reply_flow', '', 'srv_congestion (session) or srv_chunked_body (http)'),
    (r'\b[s]rv_fl[i]ght|\b[f]lights?\b(?<!in[ -]fl[i]ght)|\bfl[i]ght_|(?<!in)_[f]lights?\b', '', 'in-flight frame, frame queue'),
    (r'\b[s]rv_dues?\b|\b[s]rv_dues?_|\b[d]ues\b', '', 'timer, timer heap'),
    (r'\b([s]tream|[e]xpress|[s]till)[ _-]lanes?', '', 'interactive, preemption or snapshot worker'),
    (r'\b[l]ane\b|_[l]anes?\b|\b[l]ane_', SERVER_CODE, 'worker'),
    (r'\b[s]rv_still|\b[s]tills\b|\ba [s]till\b', '', 'snapshot'),
    (r'\b([s]tand|[s]tands|[s]tood|[s]tanding) still\b', '', 'pause'),
    (r'\b[n]ice[ _]thread', '', 'background thread'),
    (r'\b[k]ept[ _]([p]icture|[v]iew)s?\b', '', 'frame cache, saved view'),
    (r'\b[s]leepers?\b|\b[s]leeping session', SERVER_CODE, 'hibernated session'),
    (r'\b[s]rv_guard', '', 'srv_deadlines'),
    (r'\b[i]ntake\b|_[i]ntake|[i]ntake_', '', 'ingress quota'),
    (r'\bTLS [g]ates?\b|\b[s]rv_gate|\b[c]arriers?\b', '', 'TLS acceptor, TLS relay'),
    (r'\b[s]rv_strict', '', 'request-smuggling checks (http/smuggling)'),
    (r'\b[s]rv_form\b|\b[s]rv_form_', '', 'encode parameters'),
    (r'\bSRV_NOTE_|\b[s]rv_note', '', 'pending notification'),
    (r'\b[s]rv_jobs?\b|\b[s]rv_jobs?_', '', 'srv_paths, srv_path'),
    (r'\b[d]ear(er|est)?\b|_[d]ear\b', '', 'slow to encode'),
    (r'\b[f]lakes?\b|_[f]lakes?\b|\b[f]lakes?_', '', "the field's term"),
    (r'\b[p]layed_\w+|\w+[-_][p]layed\b|\b[p]layed-\w+', r'tests/', 'fake'),
    (r'\b[t]empers?\b|_[t]empers?\b', '', 'client behaviour'),
    (r'\b[c]ompany\b', r'clients/web/|tests/web/', 'participants'),
    (r'\b[o]verburdened\b|\b[s]tand-in\b', '', 'fallback reason, fallback backend'),
    (r'\b[p]ictures?\b', C_CODE, 'image or frame'),
    (r'(\b|_)[t]ake(_\w+)?\(', C_CODE, 'the verb for it: read, parse, set, acquire, pop, consume'),
    (r'^(static |inline )*(void|float|double|struct \w+) (\w+_)?[f]ind(_\w+)?\(', C_CODE, 'compute, choose or fill: find searches and may fail'),
    (r'[A-Z0-9]_[M]OST\b', '', '_MAX'),
    (r', [t]oo([.;,:)]| \*/|$)', r'(renderer|protocol|server|clients)/.*\.(c|h|cpp|glsl)$', 'also, before the verb'),
    (r'\b([n]obody|[s]omebody|[a]new)\b', '', 'name the thing'),
    (r'\b[f]or who\b|\b([l]et|[l]ets) go of\b|\b[s]o [m]any (a|an)\b', '', 'plain English'),
    (rf'\b({COUNTED}) [a]n? ({PER})\b', '', 'per'),
]


def files(source, suffixes):
    """Yields the project's own files below `source` that end in one of `suffixes`, as relative paths."""
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


def part_of(path):
    """The part of the tree that a file belongs to: sp, renderer, protocol, server, clients or tests."""
    return 'sp' if path.startswith('renderer/include/') else path.split('/')[0]


def resolve(source, path, name):
    """The file that `path` means by #include "name", or None."""
    for top in ROOTS.get(part_of(path), ['']):
        target = os.path.normpath(os.path.join(top, name))
        if os.path.isfile(os.path.join(source, target)):
            return target
    return None


def own_includes(source):
    """Yields (file, line number, name, target) for each #include "…"; target is None for a file that does not exist."""
    for path in files(source, SOURCE):
        for number, own, name in includes(source, path):
            if own:
                yield path, number, name, resolve(source, path, name)


def folder_rules(source):
    """{parent: {folder: the folders beside it that it may include}}, from CONTRIBUTING.md."""
    rules = {}
    for line in lines(source, CONTRIBUTING):
        hit = RULE.match(line)
        if hit:
            read_list(re.findall(r'[\w.]+|[{}←,]', hit.group(2)), rules.setdefault(hit.group(1), {}))
    return rules


def read_list(tokens, allowed):
    """Takes "a ← b, c", up to a closing brace, from the tokens; returns its folders."""
    names = set()
    while tokens:
        names |= read_chain(tokens, allowed)
        if tokens and tokens.pop(0) == '}':
            break
    return names


def read_chain(tokens, allowed):
    """Takes "a ← {b, c} ← d" from the tokens; returns its folders. Each may include all on its left."""
    left = set()
    while tokens and tokens[0] not in ',}':
        token = tokens.pop(0)
        if token == '←':
            continue
        names = read_list(tokens, allowed) if token == '{' else {'.' if '.' in token else token}
        for name in names:
            allowed.setdefault(name, set()).update(left)
        left |= names
    return left


def layers(o):
    rules = folder_rules(o.source)
    for path, number, name, target in own_includes(o.source):
        problem = unqualified(name, target) or (target and out_of_order(path, target, rules))
        if problem:
            yield f'{path}:{number}: {problem}'


def unqualified(name, target):
    """Returns the error in the way an include is written, or None."""
    if '..' in name.split('/'):
        return f'"{name}" climbs out of its folder; name the folder of the header instead'
    if '/' not in name:
        return f'"{name}" does not name its folder'
    return None if target else f'"{name}" is found in no include folder of this part'


def out_of_order(path, target, rules):
    """Returns why `path` may not include `target`, or None."""
    here, there = part_of(path), part_of(target)
    if here == 'tests':
        return None
    if here not in SEES:
        return f'{here}/ is not a part that lint.py knows'
    if here != there:
        return None if there in SEES[here] else f'{here} may not include {target}'
    if here in ('sp', 'protocol'):
        return None
    if here == 'clients':
        mine, other = path.split('/')[1], target.split('/')[1]
        return None if mine == other else f'clients/{mine} may not include {target}'
    parent, mine, other = parting(path, target)
    allowed = rules.get(parent, {})
    if mine not in allowed:
        return f'{parent}/{mine} stands in no rule of {CONTRIBUTING}'
    if mine != other and other not in allowed[mine]:
        return f'{os.path.dirname(path)} may not include {target}'
    return None


def parting(path, target):
    """The deepest folder that has both files, and which of its folders each lies in; "." = loose."""
    a, b = os.path.dirname(path).split('/'), os.path.dirname(target).split('/')
    same = len(os.path.commonprefix([a, b]))
    if a == b and same > 1:
        same -= 1
    return '/'.join(a[:same]), *(folders[same] if len(folders) > same else '.' for folders in (a, b))


def cycles(o):
    """Circles between folders, and between units. A unit is a source with its header and its private header."""
    folders, units = {}, {}
    for path, number, _, target in own_includes(o.source):
        if target:
            add_edge(folders, os.path.dirname(path), os.path.dirname(target), f'{path}:{number}')
            add_edge(units, unit_of(path), unit_of(target), f'{path}:{number}')
    for kind, graph in (('folders', folders), ('files', units)):
        for circle in circles(graph):
            steps = list(zip(circle, circle[1:] + circle[:1]))
            where = ', '.join(graph[a][b] for a, b in steps)
            yield f'{graph[circle[0]][circle[1]]}: circle between {kind}: {" -> ".join(circle + circle[:1])} ({where})'


def unit_of(path):
    return re.sub(r'_private$', '', os.path.splitext(path)[0])


def add_edge(graph, start, end, where):
    graph.setdefault(end, {})
    if start != end:
        graph.setdefault(start, {}).setdefault(end, where)


def circles(graph):
    """One shortest circle of each strongly connected component, as a list of nodes."""
    for component in components(graph):
        if len(component) < 2:
            continue
        first = min(component)
        trail, queue = {first: None}, [first]
        for node in queue:
            if first in graph[node]:
                circle = []
                while node is not None:
                    circle.insert(0, node)
                    node = trail[node]
                yield circle
                break
            for near in sorted(graph[node]):
                if near in component and near not in trail:
                    trail[near] = node
                    queue.append(near)


def components(graph):
    """Strongly connected components (Kosaraju), each a set of nodes."""
    order, seen = [], set()
    for root in sorted(graph):
        stack = [(root, iter(graph[root]))] if root not in seen else []
        seen.add(root)
        while stack:
            node, nears = stack[-1]
            near = next((n for n in nears if n not in seen), None)
            if near is None:
                order.append(node)
                stack.pop()
            else:
                seen.add(near)
                stack.append((near, iter(graph[near])))
    reverse = {node: [] for node in graph}
    for node, nears in graph.items():
        for near in nears:
            reverse[near].append(node)
    done = set()
    for root in reversed(order):
        if root in done:
            continue
        component, stack = set(), [root]
        done.add(root)
        while stack:
            node = stack.pop()
            component.add(node)
            for near in reverse[node]:
                if near not in done:
                    done.add(near)
                    stack.append(near)
        yield component


def third_party(o):
    for path in files(o.source, SOURCE):
        if path.startswith('tests/'):
            continue
        for number, line in enumerate(lines(o.source, path), 1):
            if not path.startswith('renderer/base/') and (hit := INTRINSIC.search(line)):
                yield f'{path}:{number}: {hit.group()} belongs to renderer/base'
        for number, own, name in includes(o.source, path):
            if own or SYSTEM.match(name) or name.startswith('sp/'):
                continue
            folders = next((folders for pattern, folders in THIRD_PARTY if re.match(pattern, name)), None)
            if folders is None:
                yield f'{path}:{number}: <{name}> has no folder yet; give it one in lint.py'
            elif os.path.dirname(path) not in folders:
                yield f'{path}:{number}: <{name}> belongs to {" and ".join(sorted(folders))}'
        if path.endswith('.cpp') and not path.endswith('_bridge.cpp'):
            yield f'{path}:1: C++ is only for bridges to C++ libraries (*_bridge.cpp)'


def globals_(o):
    """Symbols in writable sections of the libraries' objects, and #if of a backend outside the registry."""
    for path in files(o.source, SOURCE):
        if path == 'renderer/backend/registry.c' or path.startswith('tests/'):
            continue
        for number, line in enumerate(lines(o.source, path), 1):
            if re.match(r'\s*#\s*(el)?if.*\bSPLATD?_(WITH_|HAVE_)?(BACKEND|GL|CPU_BACKEND)', line):
                yield f'{path}:{number}: #if of a backend; only the registry may have one'
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
    """True if the symbol lies in .data.rel.ro: a constant table of addresses, read-only once it is loaded."""
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
        yield from compiles(o, f'renderer/include/{path}', 'c')
    for path in files(os.path.join(o.source, 'protocol'), ('.h',)):
        yield from compiles(o, f'protocol/{path}', 'c')


def headers_cpp(o):
    for path in files(os.path.join(o.source, 'renderer/include'), ('.h',)):
        yield from compiles(o, f'renderer/include/{path}', 'c++')


def compiles(o, path, language):
    command = [o.cc, f'-std={language}17', '-Wall', '-Wextra', '-Werror', '-fsyntax-only', '-x', language, '-I' + o.source,
               '-I' + os.path.join(o.source, 'renderer/include'), '-include', os.path.join(o.source, path), os.devnull]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if 'error:' in line), '?')
        yield f'{path}:1: does not compile alone as {language.upper()}: {first}'


def style(o):
    for path in files(o.source, CODE):
        text = lines(o.source, path)
        if not any('SPDX-License-Identifier: Apache-2.0' in line for line in text[:3]):
            yield f'{path}:1: no SPDX line'
        for number, line in enumerate(text, 1):
            if path.endswith(SOURCE) and len(line) > COLUMNS_MAX:
                yield f'{path}:{number}: {len(line)} columns, more than {COLUMNS_MAX}'
            if re.match(r'\s*(/\*|//|#|\*) ?[-=*#]{4,}', line):
                yield f'{path}:{number}: a banner'
            if line != line.rstrip():
                yield f'{path}:{number}: space at the end of the line'
            if re.match(ERROR_CODE, path) and ERROR_COMPARED.search(line):
                yield f'{path}:{number}: compares the place or text of an error; branch on its code'
    main = lines(o.source, 'server/main.c')
    if len(main) > 150:
        yield f'server/main.c:150: {len(main)} lines, more than 150; main only connects the parts'
    for path in files(os.path.join(o.source, 'clients/web/core'), ('.js', '.mjs')):
        for number, line in enumerate(lines(o.source, 'clients/web/core/' + path), 1):
            if re.search(r'(import|from)\s*\(?[\'"][^\'"]*app/', line):
                yield f'clients/web/core/{path}:{number}: core/ imports app/'


def length(o):
    for path in files(o.source, CODE):
        count = len(lines(o.source, path)) - 1
        if count > LINES_MAX:
            yield f'{path}:{LINES_MAX}: {count} lines, more than {LINES_MAX}; split it by concern'
    for path, number, count in functions(o.source):
        if count > FUNCTION_MAX:
            yield f'{path}:{number}: a function of {count} lines, more than {FUNCTION_MAX}; split it by job'


def functions(source):
    """Yields (file, first line, count of lines) of the functions at the left edge, in C and in the modules of the page."""
    for part in ('renderer', 'server', 'protocol', 'clients'):
        for path in files(os.path.join(source, part), ('.c', '.cpp', '.js')):
            start = None
            for number, line in enumerate(lines(source, f'{part}/{path}'), 1):
                if re.match(r'\w', line):
                    start = number if '(' in line else None
                elif line.startswith('}') and start:
                    yield f'{part}/{path}', start, number - start + 1
                    start = None


def unused(o):
    """Exports of the page that no other module and no test imports, and names in its style sheets that nothing has."""
    web = {path: '\n'.join(lines(o.source, 'clients/web/' + path))
           for path in files(os.path.join(o.source, 'clients/web'), ('.js', '.mjs', '.css', '.html', '.json'))}
    tests = ' '.join('\n'.join(lines(o.source, 'tests/' + path)) for path in files(os.path.join(o.source, 'tests'), ('.mjs',)))
    words = {path: set(re.findall(r'[\w-]+', text)) for path, text in web.items()}
    tested = set(re.findall(r'\w+', tests))
    for path, text in web.items():
        for hit in re.finditer(r'^export (?:async )?(?:function\*?|class|const|let) (\w+)', text, re.MULTILINE):
            others = any(hit.group(1) in found for other, found in words.items() if other != path)
            if not others and hit.group(1) not in tested:
                yield f'clients/web/{path}:{text.count(chr(10), 0, hit.start()) + 1}: nothing imports {hit.group(1)}'
    code = {name for path, found in words.items() if not path.endswith('.css') for name in found}
    computed = tuple(re.findall(r'([\w-]+-)\$\{', ''.join(text for path, text in web.items() if path.endswith('.js'))))
    for path, text in web.items():
        rules = re.sub(r'/\*.*?\*/', '', text, flags=re.DOTALL) if path.endswith('.css') else ''
        for selector in re.findall(r'([^{}]+)\{', rules):
            for name in re.findall(r'[.#]([A-Za-z][\w-]*)', '' if selector.strip().startswith('@') else selector):
                if name not in code and not name.startswith(computed):
                    yield f'clients/web/{path}: nothing has the class or id {name}'


def glossary(o):
    terms = [(re.compile(pattern), scope, use) for pattern, scope, use in GLOSSARY]
    paths = set(files(o.source, CODE + ('.glsl', '.md', '.txt', '.yaml', '.json', '.in'))) - {'tests/package-lock.json'}
    # grep finds the few files to read: its compiled pattern takes a tenth of the time of Python's.
    found = subprocess.run(['grep', '-lP', '|'.join(f'(?:{pattern})' for pattern, _, _ in GLOSSARY), '--', *paths], cwd=o.source,
                           capture_output=True, text=True, check=False)
    if found.returncode > 1:
        yield found.stderr.strip()
    for path in found.stdout.splitlines():
        for number, line in enumerate(lines(o.source, path), 1):
            for pattern, scope, use in terms:
                hit = pattern.search(line)
                if hit and (not scope or re.match(scope, path)):
                    yield f'{path}:{number}: "{hit.group(0)}": {use}'


def clocks(o):
    for part in ('renderer', 'server', 'protocol', 'clients'):
        for path in files(os.path.join(o.source, part), ('.c', '.h', '.cpp')):
            path = f'{part}/{path}'
            text = lines(o.source, path)
            for number, line in enumerate(text, 1):
                if path != TIME_OF_DAY and re.search(r'\bCLOCK_REALTIME|\bgettimeofday *\(|\b(time|timespec_get) *\( *(NULL|0|&)', line):
                    yield f'{path}:{number}: reads the time of day, which may jump; use srv_clock_ms(), or srv_clock_date() for a date'
                if re.search(r'\b(pthread_cond_timedwait|sem_timedwait|pthread_mutex_timedlock) *\((?!\))', line):
                    folder = os.path.dirname(os.path.join(o.source, path))
                    beside = [line for name in os.listdir(folder) if name.endswith('.c') for line in lines(folder, name)]
                    if not any(re.search('pthread_condattr_setclock|srv_clock_cond_init', line) for line in beside):
                        yield f'{path}:{number}: waits for a time of day; make the condition with srv_clock_cond_init()'


def format_(o):
    tool = shutil.which('clang-format-14')
    if not tool:
        print('skipped: no clang-format-14 (Debian package clang-format-14)')
        sys.exit(77)
    paths = list(files(o.source, SOURCE))
    done = subprocess.run([tool, '--dry-run', '--Werror', *paths], capture_output=True, text=True, check=False, cwd=o.source)
    reported = set()
    for line in done.stderr.splitlines():
        hit = re.match(r'([^:]+):(\d+):\d+: error', line)
        if hit and hit.group(1) not in reported:
            reported.add(hit.group(1))
            yield f'{hit.group(1)}:{hit.group(2)}: run clang-format-14 -i on it'
    if done.returncode and not reported:
        yield f'{tool}: {done.stderr.strip()}'


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


def types(o):
    node = shutil.which('node')
    if not node:
        print('skipped: no node (Debian package nodejs)')
        sys.exit(77)
    checker = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'types.mjs')
    done = subprocess.run([node, checker, os.path.join(o.source, 'clients', 'web')], capture_output=True, text=True, check=False)
    if done.returncode == 77:
        print(done.stdout.strip())
        sys.exit(77)
    yield from (f'clients/web/{line}' for line in done.stdout.splitlines())
    if done.returncode and not done.stdout:
        yield f'types.mjs: {done.stderr.strip()}'


RULES = {'layers': layers, 'cycles': cycles, 'third-party': third_party, 'headers': headers, 'headers-cpp': headers_cpp,
         'globals': globals_, 'clocks': clocks, 'format': format_, 'style': style, 'length': length, 'glossary': glossary,
         'words': words, 'types': types, 'unused': unused}


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
