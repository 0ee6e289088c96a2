#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares openapi.yaml and the examples with the running daemon.

  contract_test.py SPLATD SOURCE_DIR

The test calls every documented operation and renders every documented view. Every answer has a documented status and media
type, and a body that satisfies its schema. Every invalid example gives 400 or 422 with its pointer. Exit status 77: skipped.
"""
import glob
import http.client
import json
import os
import subprocess
import sys
import tempfile
import urllib.parse

try:
    import jsonschema
except ImportError as e:
    print(f'skipped: {e}; install python3-jsonschema')
    sys.exit(77)

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../protocol'))
from bundle_openapi import bundle

failures = 0
DEADLINE_S = 60
UPGRADE = {'Connection': 'Upgrade', 'Upgrade': 'websocket', 'Sec-WebSocket-Version': '13',
           'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ==', 'Sec-WebSocket-Protocol': 'splatd.v1'}


def check(ok, text):
    global failures
    if not ok:
        failures += 1
        print('FAILED:', text)


class Daemon:
    def __init__(self, program, *options, token=None):
        """token: the token of --token-file; without that option the daemon prints one"""
        self.log = tempfile.TemporaryFile()
        self.data = tempfile.TemporaryDirectory()
        with open(f'{self.data.name}/a.nrrd', 'wb') as file:
            file.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n' + bytes(8))
        self.process = subprocess.Popen([program, '--listen', '127.0.0.1:0', '--backend', 'null', '--volume',
                                         'demo:engine?size=16', '--data', self.data.name, *options], stdout=subprocess.PIPE, stderr=self.log)
        line = self.process.stdout.readline().decode()
        if 'http' not in line:
            raise RuntimeError(f'splatd did not start: {self.stop()}')
        url = urllib.parse.urlsplit(line.split()[-1])
        self.host, self.token = url.netloc, token or urllib.parse.parse_qs(url.query)['token'][0]

    def ask(self, method, path, body=None, headers=None, token=True):
        """(status, headers, bytes)"""
        connection = http.client.HTTPConnection(self.host, timeout=DEADLINE_S)
        headers = dict(headers or {})
        if token:
            headers['Authorization'] = f'Bearer {self.token if token is True else token}'
        if isinstance(body, (dict, list)):
            body = json.dumps(body)
        if body is not None:
            headers.setdefault('Content-Type', 'application/json')
        connection.request(method, path, body.encode() if isinstance(body, str) else body, headers)
        answer = connection.getresponse()
        data = b'' if answer.status == 101 else answer.read()
        connection.close()
        return answer.status, answer.headers, data

    def stop(self):
        """Ends the daemon. Returns its exit status and its log."""
        self.process.terminate()
        return self.wait()

    def wait(self):
        """Waits until the daemon exits. Returns its exit status and its log."""
        self.process.communicate(timeout=DEADLINE_S)
        self.log.seek(0)
        return self.process.returncode, self.log.read().decode(errors='replace')


class Contract:
    def __init__(self, folder):
        self.document = bundle(folder)
        self.seen = set()
        self.statuses = set()

    def node(self, value):
        while '$ref' in value:
            target = self.document
            for token in value['$ref'][2:].split('/'):
                target = target[token]
            value = target
        return value

    def check(self, method, template, status, headers, body):
        name = f'{method} {template}'
        self.seen.add((method.lower(), template))
        self.statuses.add((method.lower(), template, str(status)))
        answers = self.document['paths'][template][method.lower()]['responses']
        check(str(status) in answers, f'{name}: status {status} is not documented: {body[:200]}')
        if str(status) not in answers:
            return
        content = self.node(answers[str(status)]).get('content', {})
        kind = headers.get('Content-Type', '').split(';')[0]
        check(not content or kind in content, f'{name}: {status} as {kind}, documented {list(content)}')
        for required in self.node(answers[str(status)]).get('headers', {}):
            check(required in headers or required == 'Retry-After', f'{name}: {status} without {required}')
        if 'json' not in kind or kind not in content:
            return
        schema = {**self.node(content[kind]['schema']), 'components': self.document['components']}
        for error in list(jsonschema.Draft202012Validator(schema).iter_errors(json.loads(body)))[:2]:
            check(False, f'{name}: {status}: {"/".join(map(str, error.path))}: {error.message[:200]}')


def asker(daemon, contract):
    """Returns ask(expected status, method, path template, …), which checks the whole answer and returns its content."""
    def ask(expected, method, template, body=None, headers=None, token=True, query='', **names):
        path = template.format(**names) + query
        status, answered, data = daemon.ask(method, path, body, headers, token)
        check(status == expected, f'{method} {path}: {status}, expected {expected}: {data[:200]}')
        contract.check(method, template, status, answered, data)
        return json.loads(data) if data and 'json' in answered.get('Content-Type', '') else data
    return ask


def walk_slices(daemon, ask, template, token=True, volume='p', **names):
    """Asks for slices, and checks what the header says about the bytes."""
    planes = ('axis=2&index=3', 'axis=0&index=0&window=100,20', 'origin=8,8,4&normal=1,1e-3,-2&size=12,7&spacing=0.5&up=0,1,0')
    for plane in planes:
        for kind in ('png', 'jpeg', 'raw'):
            data = ask(200, 'GET', template, token=token, query=f'?{plane}&format={kind}', **names)
            _, headers, again = daemon.ask('GET', f'{template.format(**names)}?{plane}&format={kind}', token=token)
            about = json.loads(headers['X-Slice'])
            check(about['volume'] == volume, f'{plane} is a slice of {about["volume"]}, not {volume}')
            size = {'uint8': 1, 'float32': 4}[about['type']]
            check(data == again and (kind != 'raw' or len(data) == about['shape'][0] * about['shape'][1] * size), f'{plane} as {kind}: {about}')
            ask(304, 'GET', template, token=token, headers={'If-None-Match': headers['ETag']}, query=f'?{plane}&format={kind}', **names)
    grey, colored = (ask(200, 'GET', template, token=token, query=f'?axis=2&index=3&color={color}', **names) for color in ('grey', 'transfer'))
    check(grey != colored, 'a slice in the colours of the transfer function is not grey')
    for wrong in ('axis=x&index=0', 'axis=0&index=0&color=red', 'axis=0&index=-1', 'axis=1&index=0&format=gif', 'axis=1&index=0&window=3', 'origin=1,2&normal=0,0,1&size=1,1',
                  'axis=1&index=0&slab=3'):
        ask(400, 'GET', template, token=token, query=f'?{wrong}', **names)
    for wrong in ('axis=0', 'index=0', '', 'axis=3&index=0', 'axis=0&index=9999', 'origin=1,2,3&size=1,1', 'axis=0&index=0&size=4,4',
                  'origin=1,2,3&normal=0,0,0&size=1,1', 'origin=1,2,3&normal=0,0,1&size=1,9999', 'origin=1,2,3&normal=0,0,1&size=1,1&up=0,0,2'):
        ask(422, 'GET', template, token=token, query=f'?{wrong}', **names)


def walk_measures(ask, contract, template, given, token=True, **names):
    """Sends every example of a measurement."""
    folder = f'{sys.argv[2]}/protocol/examples/measure'
    for path in sorted(glob.glob(f'{folder}/valid/*.json')):
        with open(path, encoding='utf-8') as f:
            wanted = json.load(f)
        answer = ask(200, 'POST', template, {**given, **wanted}, token=token, **names)
        check(answer['kind'] == wanted['kind'] and answer['points'] == wanted['points'], f'{path}: {answer}')
        check(('outside' in path) == (answer['outside'] > 0) == ('outside of' in answer.get('note', '')), f'{path}: {answer}')
        check(('statistics' in answer) == (wanted['kind'] in ('profile', 'rectangle', 'ellipse')), f'{path}: {answer}')
        check(len(answer.get('profile', {}).get('values', [])) == wanted.get('samples', len(answer.get('profile', {}).get('values', []))), path)
    for path in sorted(glob.glob(f'{folder}/invalid/*.json')):
        with open(path, encoding='utf-8') as f:
            wanted = json.load(f)
        answer = ask(422, 'POST', template, {**given, **wanted['request']}, token=token, **names)
        check(answer.get('pointer') == wanted['error']['pointer'], f'{path}: {answer}')


def walk(daemon, contract):
    """Calls each operation at least once, with valid and invalid requests."""
    ask, api = asker(daemon, contract), '/api/v1'
    ask(200, 'GET', '/healthz', token=False)
    ask(200, 'GET', '/readyz', token=False)
    ask(200, 'GET', '/metrics')
    ask(401, 'GET', '/metrics', token=False)
    served = ask(200, 'GET', f'{api}/openapi.json', token=False)
    check(served == json.loads(json.dumps(contract.document)), 'openapi.json is not the bundle of openapi.yaml and view.schema.json')
    for name in ('openapi.yaml', 'view.schema.json', 'stream.schema.json', 'stream.md'):
        ask(200, 'GET', f'{api}/{name}', token=False)
    ask(202, 'POST', f'{api}/volumes', {'uri': 'demo:phantom?size=16', 'id': 'p', 'name': 'a head'})
    ask(201, 'POST', f'{api}/volumes', {'uri': 'demo:phantom?size=16', 'id': 'p'})
    ask(202, 'POST', f'{api}/volumes', {'uri': 'demo:galaxy?size=16', 'id': 'graded'})
    for volume in ('engine', 'p', 'graded'):
        while ask(200, 'GET', f'{api}/volumes/{{id}}', id=volume)['state'] == 'loading':
            pass
    check([len(c) for c in ask(200, 'GET', f'{api}/volumes/{{id}}', id='graded')['coordinates']] == [16, 16, 8],
          'a rectilinear volume has coordinates')
    check('coordinates' not in ask(200, 'GET', f'{api}/volumes/{{id}}', id='p'), 'an evenly spaced volume has no coordinates')
    ask(409, 'POST', f'{api}/volumes', {'uri': 'demo:engine?size=17', 'id': 'p'})
    ask(400, 'POST', f'{api}/volumes', '{')
    ask(422, 'POST', f'{api}/volumes', {'path': 'a', 'uri': 'demo:engine'})
    ask(400, 'GET', f'{api}/volumes', query='?limit=1')
    ask(400, 'POST', f'{api}/render', {}, query='?qualty=50')
    ask(400, 'POST', f'{api}/render', {}, query='?quality=50&quality=60')
    ask(415, 'POST', f'{api}/volumes', 'x', {'Content-Type': 'text/plain'})
    ask(413, 'POST', f'{api}/volumes', ' ' * (2 << 20))
    ask(200, 'GET', f'{api}/volumes')
    ask(200, 'GET', f'{api}/volumes/{{id}}/view', id='p')
    ask(404, 'GET', f'{api}/volumes/{{id}}/view', id='none')
    for axis, bins in (('', 256), ('?axis=value', 256), ('?axis=value,gradient', 128 * 64)):
        histogram = ask(200, 'GET', f'{api}/volumes/{{id}}/histogram', query=axis, id='p')
        check(len(histogram['counts']) == bins and sum(histogram['counts']) == histogram['samples'] == 16 ** 3,
              f'the histogram {axis} counts every sample')
    ask(400, 'GET', f'{api}/volumes/{{id}}/histogram', query='?axis=gradient', id='p')
    ask(400, 'GET', f'{api}/volumes/{{id}}/histogram', query='?axis', id='p')
    ask(404, 'GET', f'{api}/volumes/{{id}}/histogram', id='none')
    walk_slices(daemon, ask, f'{api}/volumes/{{id}}/slice', id='p')
    walk_measures(ask, contract, f'{api}/measure', {'volume': 'p'})
    ask(422, 'POST', f'{api}/measure', {'kind': 'marker', 'points': [[0, 0, 0]]})
    ask(422, 'POST', f'{api}/measure', {'volume': 'none', 'kind': 'marker', 'points': [[0, 0, 0]]})
    ask(204, 'DELETE', f'{api}/volumes/{{id}}', id='p')
    ask(404, 'DELETE', f'{api}/volumes/{{id}}', id='p')
    for kind in ('jpeg', 'png', 'webp', 'exr'):
        ask(200, 'POST', f'{api}/render', {'size': [16, 8]}, query=f'?format={kind}&quality=50')
    bodies = contract.document['paths'][f'{api}/render']['post']['requestBody']['content']
    for example in bodies['application/json']['examples'].values():
        ask(200, 'POST', f'{api}/render', {**example['value'], 'size': [16, 8]})
    ask(406, 'POST', f'{api}/render', {}, {'Accept': 'text/html'})
    ask(400, 'POST', f'{api}/render', {}, query='?quality=0')
    _, headers, _ = daemon.ask('POST', f'{api}/render', {'size': [16, 8]})
    ask(304, 'POST', f'{api}/render', {'size': [16, 8]}, {'If-None-Match': headers['ETag']})
    session = ask(201, 'POST', f'{api}/sessions', {'view': {'size': [32, 32]}})
    ask(422, 'POST', f'{api}/sessions', {'view': {'size': [0, 1]}})
    walk_measures(ask, contract, f'{api}/sessions/{{id}}/measure', {}, token=session['tokens']['view'], id=session['id'])
    check(ask(200, 'GET', f'{api}/sessions/{{id}}/measures', token=session['tokens']['view'], id=session['id']) == {'measures': []}, 'measures')
    ask(200, 'GET', f'{api}/sessions/{{id}}/measures', query='?format=csv', id=session['id'])
    ask(400, 'GET', f'{api}/sessions/{{id}}/measures', query='?format=xml', id=session['id'])
    walk_session_measures(ask, contract, f'{api}/sessions/{{id}}/measures', session)
    fork = ask(201, 'POST', f'{api}/sessions', {'from': session['id']})
    listed = walk_pages(ask, f'{api}/sessions', 'sessions')
    check(sorted(s['id'] for s in listed) == sorted([session['id'], fork['id']]), f'sessions: {listed}')
    check(all(s['volume'] == 'engine' and not s['hibernated'] and s['participants'] == 0 for s in listed), f'sessions: {listed}')
    ask(401, 'GET', f'{api}/sessions', token=session['tokens']['control'])
    walk_saved_views(daemon, ask, api)
    walk_presets(ask, api)
    walk_paths(daemon, contract, ask, api)
    names = {'id': session['id']}
    ask(200, 'GET', f'{api}/sessions/{{id}}', **names)
    same = ask(200, 'GET', f'{api}/sessions/{{id}}/histogram', token=session['tokens']['view'], query='?axis=value,gradient', **names)
    check(same == ask(200, 'GET', f'{api}/volumes/{{id}}/histogram', query='?axis=value,gradient', id='engine'),
          'a session gives the histogram of its volume')
    ask(401, 'GET', f'{api}/sessions/{{id}}/histogram', token='none', **names)
    part = ask(200, 'GET', f'{api}/sessions/{{id}}/visible', token=session['tokens']['view'], **names)
    check(part['volume'] == 'engine' and part['visible'] and all(low < high for low, high in zip(*part['box'])), f'visible: {part}')
    ask(401, 'GET', f'{api}/sessions/{{id}}/visible', token='none', **names)
    snapshot = f'{api}/sessions/{{id}}/snapshot'
    for kind in ('jpeg', 'png', 'webp', 'exr'):
        ask(200, 'GET', snapshot, token=session['tokens']['view'], query=f'?format={kind}&size=8,6&background=%5B0,0,0,0%5D', **names)
    _, headers, _ = daemon.ask('GET', f'{api}/sessions/{session["id"]}/snapshot')
    ask(304, 'GET', snapshot, headers={'If-None-Match': headers['ETag']}, **names)
    ask(406, 'GET', snapshot, headers={'Accept': 'text/html'}, **names)
    ask(401, 'GET', snapshot, token='none', **names)
    for wrong in ('size=8', 'background=%5B', 'quality=0', 'camera=%7B%7D'):
        ask(400, 'GET', snapshot, query=f'?{wrong}', **names)
    for wrong in ('size=8,0', 'background=5', 'background=%5B0,0,0%5D'):
        ask(422, 'GET', snapshot, query=f'?{wrong}', **names)
    walk_slices(daemon, ask, f'{api}/sessions/{{id}}/slice', token=session['tokens']['view'], volume='engine', **names)
    ask(401, 'GET', f'{api}/sessions/{{id}}/slice', token='none', query='?axis=0&index=0', **names)
    ask(404, 'GET', f'{api}/volumes/{{id}}/slice', query='?axis=0&index=0', id='none')
    patch = {'view': {'camera': {'fov_y': 50}}}
    ask(200, 'PATCH', f'{api}/sessions/{{id}}', patch, token=session['tokens']['control'], **names)
    ask(403, 'PATCH', f'{api}/sessions/{{id}}', patch, token=session['tokens']['view'], **names)
    ask(422, 'PATCH', f'{api}/sessions/{{id}}', {'view': {'camera': {'fov_y': 500}}}, **names)
    for rest in ('volumes', 'volumes/{volume}', 'volumes/{volume}/view'):
        for token in session['tokens'].values():
            ask(200, 'GET', f'{api}/sessions/{{id}}/{rest}', token=token, volume='engine', **names)
        ask(404, 'GET', f'{api}/sessions/{{id}}/{rest}', id='0' * 16, volume='engine')
        if '{' in rest:
            ask(404, 'GET', f'{api}/sessions/{{id}}/{rest}', volume='none', **names)
    ask(101, 'GET', f'{api}/sessions/{{id}}/stream', headers=UPGRADE, **names)
    ask(426, 'GET', f'{api}/sessions/{{id}}/stream', **names)
    ask(403, 'GET', f'{api}/sessions/{{id}}/stream', headers={**UPGRADE, 'Origin': 'http://elsewhere'}, **names)
    ask(204, 'DELETE', f'{api}/sessions/{{id}}', **names)
    ask(404, 'GET', f'{api}/sessions/{{id}}', **names)
    ask(404, 'GET', f'{api}/sessions/{{id}}/visible', **names)
    for template in contract.document['paths']:
        for method in ('get', 'post', 'put', 'patch', 'delete'):
            operation = contract.document['paths'][template].get(method)
            if operation and operation.get('security') != []:
                ask(401, method.upper(), template, token=False, id='engine', name='x', frame='0', measure='x', volume='x')
            check(not operation or (method, template) in contract.seen, f'{method} {template} was not called')


def walk_session_measures(ask, contract, template, session):
    """Adds, replaces, changes and removes measurements, as a script does."""
    one, owner, names = f'{template}/{{measure}}', session['tokens']['control'], {'id': session['id']}
    bodies = contract.document['paths'][template]['post']['requestBody']['content']['application/json']['examples']
    for example in bodies.values():
        made = ask(201, 'POST', template, example['value'], token=owner, **names)
        check(example['value'].items() <= made.items(), f'{made} is not {example["value"]}')
        ask(204, 'DELETE', one, measure=made['id'], **names)
    names['measure'] = '-w_1'
    wall = {'kind': 'distance', 'points': [[-2.5, 0, 0], [1.5, 0, 0]], 'text': 'Wall'}
    made = ask(201, 'PUT', one, wall, token=owner, **names)
    check(made['value'] == 4 and made['id'] == '-w_1' and made['outside'] > 0 and 'outside of the volume' in made['note'], f'{made}')
    check(ask(200, 'PUT', one, {**wall, 'text': 'wall'}, **names)['text'] == 'wall', 'replaced')
    changed = ask(200, 'PATCH', one, {'hidden': True}, **names)
    check(changed['hidden'] and changed['text'] == 'wall', f'{changed}')
    check(not ask(200, 'PUT', one, {**wall, 'text': ''}, **names)['hidden'], 'a replaced measurement keeps a member')
    for body, pointer in (({'kind': 'marker', 'points': [[0, 0, 0]]}, '/kind'), ({'points': [[0, 0, 0]]}, '/points'), ({'size': 1}, '/size')):
        check(ask(422, 'PATCH', one, body, **names)['pointer'] == pointer, f'{body}')
    for body in ({}, {'text': 'x'}, {'kind': 'marker'}, {**wall, 'id': 'x'}, {**wall, 'text': 7}, {**wall, 'points': [[0, 0, 0], [0, 0, 2e18]]}):
        ask(422, 'PUT', one, body, **names)
        ask(422, 'POST', template, body, id=session['id'])
    listed = ask(200, 'GET', template, id=session['id'])['measures']
    check([(m['id'], m['text']) for m in listed] == [('-w_1', '')], f'{listed}')
    for method, body in (('PUT', wall), ('PATCH', {'text': 'x'}), ('DELETE', None)):
        ask(403, method, one, body, token=session['tokens']['view'], **names)
        ask(422, method, one, body, id=session['id'], measure='a.b')
        ask(401, method, one, body, token='none', **names)
        ask(404, method, one, body, id='0' * 16, measure='x')
    ask(403, 'POST', template, wall, token=session['tokens']['view'], id=session['id'])
    ask(404, 'POST', template, wall, id='0' * 16)
    ask(404, 'PATCH', one, {'text': 'x'}, id=session['id'], measure='none')
    ask(204, 'DELETE', one, token=owner, **names)
    check('no measurement' in ask(404, 'DELETE', one, token=owner, **names)['detail'], 'removed twice')


def walk_pages(ask, template, name):
    """Returns all items of a list, and checks that pages of one item give the same list."""
    whole = ask(200, 'GET', template)
    check('next' not in whole, f'{template}: a complete list has a next page')
    single, query = [], '?limit=1'
    while query:
        page = ask(200, 'GET', template, query=query)
        single += page[name]
        query = f'?limit=1&after={page["next"]}' if 'next' in page else None
    check([i['id'] for i in single] == [i['id'] for i in whole[name]], f'{template}: {single} is not {whole}')
    for wrong in ('limit=0', 'limit=1001', 'limit=x', 'limit=1x', 'limit=-1', 'limit='):
        ask(400, 'GET', template, query=f'?{wrong}')
    return whole[name]


def walk_saved_views(daemon, ask, api):
    kept = ask(201, 'POST', f'{api}/views', {'size': [16, 8]})
    ask(422, 'POST', f'{api}/views', {'size': [0, 8]})
    ask(400, 'POST', f'{api}/views', '{')
    ask(200, 'GET', f'{api}/views/{{id}}', **kept)
    ask(304, 'GET', f'{api}/views/{{id}}', headers={'If-None-Match': '"' + kept['id'] + '"'}, **kept)
    ask(404, 'GET', f'{api}/views/{{id}}', id='0' * 32)
    ask(201, 'POST', f'{api}/sessions', {'from': kept['id']})
    template = f'{api}/render/{{id}}'
    camera = urllib.parse.quote('{"fov_y": 40}')
    for kind in ('jpeg', 'png', 'webp', 'exr'):
        ask(200, 'GET', template, query=f'?format={kind}&quality=50&size=8,8&camera={camera}', **kept)
    _, headers, _ = daemon.ask('GET', f'{api}/render/{kept["id"]}')
    ask(304, 'GET', template, headers={'If-None-Match': headers['ETag']}, **kept)
    ask(406, 'GET', template, headers={'Accept': 'text/html'}, **kept)
    ask(404, 'GET', template, id='0' * 32)
    other = ask(201, 'POST', f'{api}/views', {'size': [17, 8]})
    listed = walk_pages(ask, f'{api}/views', 'views')
    check(sorted((v['id'], v['volume'], v['size'][0]) for v in listed) ==
          sorted([(kept['id'], 'engine', 16), (other['id'], 'engine', 17)]), f'views: {listed}')
    for body, status in (({'name': 'Front, Ω'}, 204), ({'name': None}, 204), ({}, 422), ({'name': ''}, 422), ({'name': 7}, 422),
                         ({'name': 'x' * 201}, 422), ({'id': 'x'}, 422)):
        ask(status, 'PATCH', f'{api}/views/{{id}}', body, **other)
    ask(204, 'DELETE', f'{api}/views/{{id}}', **other)
    ask(404, 'DELETE', f'{api}/views/{{id}}', **other)
    ask(404, 'PATCH', f'{api}/views/{{id}}', {'name': 'x'}, **other)
    ask(404, 'GET', f'{api}/views/{{id}}', **other)
    check(len(ask(200, 'GET', f'{api}/views')['views']) == 1, 'the list does not hold exactly one view')
    for wrong in ('size=8', 'size=8,8,8', 'size=-1,2', 'camera=%7B', 'quality=0'):
        ask(400, 'GET', template, query=f'?{wrong}', **kept)
    for wrong in ('size=8,0', 'size=8,9999', 'camera=5', f'camera={urllib.parse.quote(json.dumps(dict(x=1)))}'):
        ask(422, 'GET', template, query=f'?{wrong}', **kept)


def walk_paths(daemon, contract, ask, api):
    one, keys = f'{api}/paths/{{id}}', [{'frame': 1, 'view': {'camera': {'fov_y': 20}}}]
    bodies = contract.document['paths'][f'{api}/paths']['post']['requestBody']['content']
    ask(202, 'POST', f'{api}/paths', bodies['application/json']['examples']['turn']['value'])
    pictures = ask(202, 'POST', f'{api}/paths', {'size': [16, 8], 'frames': 2, 'keyframes': keys, 'format': 'jpeg'})
    movie = ask(202, 'POST', f'{api}/paths', {'size': [16, 8], 'frames': 2, 'keyframes': keys, 'format': 'webm'})
    for path in (pictures, movie):
        for name in ('done', 'state', 'bytes'):
            path.pop(name)
        events = ask(200, 'GET', f'{one}/events', id=path['id']).decode()
        check(events.endswith('\n\n') and 'event: done\n' in events, f'the last event is not done: {events[-300:]}')
        last = events.rstrip().split('\n\n')[-1].split('\n')[0][len('id: '):]
        ask(204, 'GET', f'{one}/events', headers={'Last-Event-ID': last}, id=path['id'])
        told = ask(200, 'GET', one, id=path['id'])
        check({**told, **path} == told and told['state'] == 'done', f'the path is {told}, requested was {path}')
    listed = [p['id'] for p in ask(200, 'GET', f'{api}/paths')['paths']]
    check(listed == sorted(listed) and {pictures['id'], movie['id']} <= set(listed), 'the paths are not in the order of their ids')
    frame = {'id': pictures['id'], 'frame': '1'}
    ask(200, 'GET', f'{one}/frames/{{frame}}', **frame)
    ask(304, 'GET', f'{one}/frames/{{frame}}', headers={'If-None-Match': f'"{pictures["id"]}-1"'}, **frame)
    for wrong in ('2', '-1', 'x', '1x', '9999999999'):
        ask(404, 'GET', f'{one}/frames/{{frame}}', id=pictures['id'], frame=wrong)
    ask(404, 'GET', f'{one}/frames/{{frame}}', id=movie['id'], frame='0')
    ask(200, 'GET', f'{one}/archive', id=pictures['id'])
    ask(404, 'GET', f'{one}/archive', id=movie['id'])
    ask(200, 'GET', f'{one}/movie', id=movie['id'])
    ask(304, 'GET', f'{one}/movie', headers={'If-None-Match': f'"{movie["id"]}-movie"'}, id=movie['id'])
    ask(404, 'GET', f'{one}/movie', id=pictures['id'])
    for target, at in ((f'{one}/frames/{{frame}}', frame), (f'{one}/movie', {'id': movie['id']})):
        ask(206, 'GET', target, headers={'Range': 'bytes=1-'}, **at)
        ask(416, 'GET', target, headers={'Range': 'bytes=99999999-'}, **at)
    slow = ask(202, 'POST', f'{api}/paths', {'size': [1024, 1024], 'frames': 999, 'keyframes': keys})
    ask(409, 'GET', f'{one}/frames/{{frame}}', id=slow['id'], frame='998')
    ask(409, 'GET', f'{one}/archive', id=slow['id'])
    slow_movie = ask(202, 'POST', f'{api}/paths', {'frames': 9, 'keyframes': keys, 'format': 'webm'})
    ask(409, 'GET', f'{one}/movie', id=slow_movie['id'])
    for path in (slow, slow_movie, pictures, movie):
        ask(204, 'DELETE', one, id=path['id'])
        for rest in ('', '/events', '/archive', '/movie'):
            ask(404, 'GET', one + rest, id=path['id'])
        ask(404, 'DELETE', one, id=path['id'])
    ask(422, 'POST', f'{api}/paths', {'frames': 2})
    ask(400, 'POST', f'{api}/paths', '{')
    ask(415, 'POST', f'{api}/paths', 'x', {'Content-Type': 'text/plain'})
    ask(413, 'POST', f'{api}/paths', ' ' * (2 << 20))


def walk_presets(ask, api):
    one = f'{api}/presets/{{name}}'
    bones = {'transfer_function': {'points': [{'value': 0, 'color': [1, 1, 1], 'opacity': 0},
                                              {'value': 9, 'color': [1, 1, 1], 'opacity': 0.5}]}}
    ask(201, 'PUT', one, bones, name='bones')
    ask(204, 'PUT', one, bones, name='bones')
    ask(201, 'PUT', one, {'volume': 'not-there', 'camera': {'fov_y': 20}}, name='a.b-c_D9')
    check(ask(200, 'GET', one, name='bones') == bones, 'a preset is not returned as it was saved')
    check(ask(200, 'GET', f'{api}/presets')['presets'] == ['bones', 'a.b-c_D9'], 'the presets are not in their order')
    ask(404, 'GET', one, name='none')
    ask(422, 'PUT', one, bones, name='a%20b')
    ask(422, 'PUT', one, bones, name='x' * 65)
    ask(422, 'PUT', one, {'camera': {'fov_y': 999}}, name='y')
    ask(422, 'PUT', one, {'nonsense': 1}, name='y')
    ask(422, 'PUT', one, [], name='y')
    ask(400, 'PUT', one, '{', name='y')
    ask(415, 'PUT', one, 'x', {'Content-Type': 'text/plain'}, name='y')
    ask(413, 'PUT', one, ' ' * (2 << 20), name='y')
    ask(204, 'DELETE', one, name='a.b-c_D9')
    ask(404, 'DELETE', one, name='a.b-c_D9')


def check_examples(daemon, folder):
    count = 0
    for path in sorted(glob.glob(f'{folder}/examples/invalid/*.json')):
        with open(path, encoding='utf-8') as f:
            example = json.load(f)
        if 'hex' in example:
            body = bytes.fromhex(example['hex'])
        else:
            body = (example['text'] if 'text' in example else json.dumps(example['view'])).encode()
        if not body:
            continue  # no body stands for {}
        wanted = 400 if example['error']['code'] == 'format' else 422
        status, _, data = daemon.ask('POST', '/api/v1/render', body)
        answer = json.loads(data) if data[:1] == b'{' else {}
        check((status, answer.get('pointer', '')) == (wanted, example['error']['pointer']),
              f'{os.path.basename(path)} over HTTP: {status} {answer}')
        count += 1
    return count


def main():
    folder = f'{sys.argv[2]}/protocol'
    daemon, contract = Daemon(sys.argv[1]), Contract(folder)
    try:
        walk(daemon, contract)
        examples = check_examples(daemon, folder)
    finally:
        status, log = daemon.stop()
    check(status == 0, f'splatd ended with {status}: {log[-2000:]}')
    check('Sanitizer' not in log and 'runtime error' not in log, log[-4000:])
    print(f'{len(contract.seen)} operations, {examples} examples, {failures} failures')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
