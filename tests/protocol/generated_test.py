#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the daemon against openapi.yaml with requests that are generated from it.

  generated_test.py SPLATD SOURCE_DIR

The test calls every operation many times, with valid and invalid bodies, parameters, headers and tokens. The contract must
document every answer; the daemon must not refuse a valid request as malformed and must not accept an invalid one. At the
end every documented status has occurred, except those that only overload or a failure causes. SPLATD_SEED selects other
requests, SPLATD_REQUESTS their number per operation. Exit status 77: skipped.
"""
import http.client
import json
import os
import random
import re
import sys
import tempfile

import contract_test
from contract_test import jsonschema, UPGRADE, Contract, Daemon, asker, check, walk
from generate import Requests

MALFORMED = {400, 406, 422}
REQUESTS = int(os.environ.get('SPLATD_REQUESTS', 120))
FILE = b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n' + bytes(8)
# Statuses that a request alone cannot cause: failures (integration.life, unit.server_interactive_worker), sessions of an
# earlier run whose volume is still loading (integration.state), a full disk (integration.paths).
ELSEWHERE = {'500', ('post', '/api/v1/paths', '507'), ('post', '/api/v1/uploads', '507'), ('post', '/api/v1/uploads', '409'), ('delete', '/api/v1/uploads/{id}', '409'), ('patch', '/api/v1/uploads/{id}', '507'), ('get', '/api/v1/sessions/{id}', '409'),
             ('get', '/api/v1/sessions/{id}/histogram', '409'), ('get', '/api/v1/sessions/{id}/visible', '409'), ('get', '/api/v1/sessions/{id}/snapshot', '409'),
             ('get', '/api/v1/sessions/{id}/slice', '409'), ('get', '/api/v1/sessions/{id}/stream', '409'),
             *(('get', '/api/v1/sessions/{id}/volumes' + rest, '409') for rest in ('', '/{volume}', '/{volume}/view')),
             ('post', '/api/v1/sessions/{id}/measure', '409'), ('get', '/api/v1/sessions/{id}/measures', '409'),
             ('post', '/api/v1/sessions/{id}/measures', '409'), *((method, '/api/v1/sessions/{id}/measures/{measure}', '409') for method in ('put', 'patch', 'delete'))}

# Fields with rules that a schema cannot express (its description lists them), or that a backend cannot render.
BEYOND = re.compile(
    r'(/view)?(/volume|/camera(/position|/target|/up|/distance)?|/transfer_function/(points/\d+/value|gradient/\d+/magnitude|order)'
    r'|/filter/c_m(in|ax)|/clip/box/\d/\d|/clip/planes/\d/normal|/slices/(normal|in_3d)|/time/step|/compositing/colors|/shading/(lights/\d/direction|occlusion|shadow)|/layers/\d+/(type|low)|/edits/\d+/(normal|box/0/\d|range/0))|/size/[01]|/from|/uri|/path|/source|/id|/name|/text|/unit|/value_unit|/points(/\d+)*|/range(/[01])?|/samples|/frames|/keyframes/\d+(/.*)?')


class Caller:
    def __init__(self, daemon, contract, rng):
        self.daemon, self.contract, self.rng = daemon, contract, rng
        self.requests = Requests(contract.document, rng)
        self.ids = {'volumes': ['engine']}

    def ids_of(self, template):
        """Returns the existing ids for a path: /api/v1/views/{id} and /api/v1/render/{id} take ids of views, and so on."""
        kind = template.split('/')[3] if template.startswith('/api/') else ''
        return self.ids.setdefault('views' if kind == 'render' else kind, [])

    def token(self, secured):
        """(token, is_good)"""
        roll = self.rng.random()
        if not secured or roll < 0.75:
            return self.daemon.token, True
        if roll < 0.85:
            return None, False
        return self.rng.choice(['wrong', self.daemon.token[:-1], self.daemon.token + 'x', "'", '🦊'.encode().hex()]), False

    def remember(self, ids, made, method, status, answer):
        """Updates the existing ids: the daemon names sessions, views and paths; the client names presets."""
        given = answer.get('id') if isinstance(answer, dict) else None
        new = {('post', 201): given, ('post', 202): given, ('put', 201): made.get('name')}.get((method, status))
        if new and len(ids) < 20:
            ids.append(new)
        if (method, status) == ('delete', 204):
            ids[:] = [name for name in ids if name != made['name']]

    def call(self, template, method):
        operation = self.contract.document['paths'][template][method]
        secured = operation.get('security') != []
        ids = self.ids_of(template)
        if (method, template) == ('delete', '/api/v1/volumes/{id}'):
            ids = []  # other calls need the volume
        if template == '/api/v1/volumes':
            ids = []  # a new volume need not be ready
        made = self.requests.request(template, method, ids)
        token, is_good = self.token(secured)
        status, headers, data = self.daemon.ask(method.upper(), made['path'], made['body'], made['headers'], token=token or False)
        self.contract.check(method, template, status, headers, data)
        answer = json.loads(data) if data and 'json' in headers.get('Content-Type', '') else None
        if not template.endswith('{measure}'):  # ids of measurements are no ids of sessions
            self.remember(ids, made, method, status, answer)
        self.judge(made, is_good, method, status, answer)

    def judge(self, made, is_good, method, status, answer):
        what = f'{method.upper()} {made["path"][:200]} {made["headers"]} {(made["body"] or "")[:300]} → {status} {answer if status >= 400 else ""}'
        if '%00' in made['path']:
            check(status == 400, f'a path with %00 is not refused: {what}')
        elif not is_good:
            check(status in (401, 404) if made['path'].startswith('/api/v1/sessions/') else status == 401, f'accepted without a valid token: {what}')
        elif not made['has_id'] and '{' not in made['path'] and status == 404:
            pass
        elif not made['is_sound']:
            check(status in MALFORMED | {404, 409, 503}, f'an invalid request is accepted: {what}')
            check(status != 503 or 'memory' not in answer['detail'], f'an invalid request is answered with out of memory: {what}')
        else:
            check(status != 400, f'a valid request is refused as malformed: {what}')
            pointer = answer.get('pointer', '') if status == 422 else ''
            is_beyond = BEYOND.fullmatch(pointer) and (made['body'] is None or '/size/' not in pointer)
            check(not pointer or is_beyond, f'a valid request is refused: {what}')
        if status in (400, 422) and answer:
            check(len(answer['detail']) > 5, f'the answer has no reason: {what}')
            check(answer.get('pointer', '/')[:1] == '/', f'the pointer is not a JSON pointer: {what}')


def operations(document):
    for template, item in document['paths'].items():
        for method in ('get', 'post', 'put', 'patch', 'delete'):
            if method in item and not template.endswith('/stream') and (template, method) != ('/api/v1/uploads/{id}', 'patch'):
                yield template, method


def bring_about(daemon, contract):
    """Causes the statuses that random requests hardly cause."""
    ask, api = asker(daemon, contract), '/api/v1'
    for template, method in operations(contract.document):
        if 'requestBody' in contract.document['paths'][template][method]:
            session = ask(201, 'POST', f'{api}/sessions', {})
            names = {'id': session['id'], 'name': 'x', 'measure': 'x'}
            ask(400, method.upper(), template, '{', **names)
            ask(413, method.upper(), template, ' ' * (2 << 20), **names)
            ask(415, method.upper(), template, 'x', {'Content-Type': 'text/plain'}, **names)
            ask(204, 'DELETE', f'{api}/sessions/{{id}}', id=session['id'])
        if '{' in template:
            ask(400, method.upper(), template, id='%00', name='%00', frame='%00', measure='%00', volume='%00')
    for name in ('openapi.json', 'openapi.yaml', 'view.schema.json', 'stream.schema.json', 'stream.md'):
        ask(304, 'GET', f'{api}/{name}', headers={'If-None-Match': '*'})
    # A volume that is too large for the memory exists, but cannot be rendered.
    ask(202, 'POST', f'{api}/volumes', {'uri': 'demo:engine?size=512', 'id': 'large'})
    while ask(200, 'GET', f'{api}/volumes/{{id}}', id='large')['state'] == 'loading':
        pass
    session = ask(201, 'POST', f'{api}/sessions', {})
    ask(409, 'GET', f'{api}/volumes/{{id}}/view', id='large')
    ask(409, 'GET', f'{api}/volumes/{{id}}/histogram', id='large')
    ask(409, 'GET', f'{api}/volumes/{{id}}/slice', query='?axis=0&index=0', id='large')
    ask(409, 'POST', f'{api}/measure', {'volume': 'large', 'kind': 'marker', 'points': [[0, 0, 0]]})
    ask(409, 'POST', f'{api}/render', {'volume': 'large'})
    ask(409, 'POST', f'{api}/views', {'volume': 'large'})
    ask(409, 'POST', f'{api}/paths', {'view': {'volume': 'large'}, 'frames': 1, 'keyframes': [{'frame': 0, 'view': {}}]})
    ask(409, 'POST', f'{api}/sessions', {'view': {'volume': 'large'}})
    ask(409, 'PATCH', f'{api}/sessions/{{id}}', {'view': {'volume': 'large'}}, id=session['id'])
    ask(422, 'GET', f'{api}/files', query='?path=a.nrrd')
    ask(403, 'POST', f'{api}/sessions', {'from': session['id']}, token=session['tokens']['view'])
    stream = f'{api}/sessions/{{id}}/stream'
    ask(400, 'GET', stream, headers={**UPGRADE, 'Sec-WebSocket-Key': 'short'}, id=session['id'])
    ask(404, 'GET', stream, headers=UPGRADE, id='0' * 16)
    uploads(ask, f'{api}/uploads')
    # A saved view whose volume was unloaded cannot be rendered.
    ask(202, 'POST', f'{api}/volumes', {'uri': 'demo:phantom?size=8', 'id': 'passing'})
    while ask(200, 'GET', f'{api}/volumes/{{id}}', id='passing')['state'] == 'loading':
        pass
    kept = ask(201, 'POST', f'{api}/views', {'volume': 'passing'})
    ask(204, 'DELETE', f'{api}/volumes/{{id}}', id='passing')
    ask(409, 'GET', f'{api}/render/{{id}}', **kept)


def uploads(ask, template):
    """Sends a file in parts, rightly and wrongly."""
    one, tus = f'{template}/{{id}}', {'Tus-Resumable': '1'}
    kind = {'Content-Type': 'application/offset+octet-stream'}
    at, wrong = {**kind, 'Upload-Offset': '0'}, {'Upload-Checksum': 'md5 AAAAAAAAAAAAAAAAAAAAAA=='}
    ask(204, 'OPTIONS', template)
    for existing in ask(200, 'GET', template)['uploads']:
        ask(204, 'DELETE', one, id=existing['id'])
    made = ask(201, 'POST', template, {'name': 'a.nrrd', 'bytes': len(FILE)})
    for method in ('GET', 'POST', 'OPTIONS'):
        ask(412, method, template, headers=tus)
    for method, body in (('GET', None), ('DELETE', None), ('PATCH', 'x')):
        ask(412, method, one, body, {**at, **tus}, id=made['id'])
    ask(404, 'PATCH', one, 'x', at, id='0' * 32)
    ask(409, 'PATCH', one, 'x', {**kind, 'Upload-Offset': '1'}, id=made['id'])
    ask(415, 'PATCH', one, 'x', {**at, 'Content-Type': 'text/plain'}, id=made['id'])
    ask(400, 'PATCH', one, 'x', kind, id=made['id'])
    ask(460, 'PATCH', one, 'x', {**at, **wrong}, id=made['id'])
    ask(413, 'PATCH', one, FILE + b'x', at, id=made['id'])
    ask(409, 'POST', '/api/v1/volumes', {'upload': made['id']})
    ask(204, 'PATCH', one, FILE, at, id=made['id'])
    ask(202, 'POST', '/api/v1/volumes', {'upload': made['id'], 'id': 'sent'})
    while ask(200, 'GET', '/api/v1/volumes/{id}', id='sent')['state'] == 'loading':
        pass
    ask(404, 'GET', one, id=made['id'])
    ask(204, 'DELETE', '/api/v1/volumes/{id}', id='sent')


def all_operations(document):
    for template, item in document['paths'].items():
        for method in ('get', 'post', 'put', 'patch', 'delete'):
            if method in item:
                yield template, method, item[method].get('security') != []


def refused(daemon, contract, status, template, method, headers=(), query='', token=None):
    """Sends a request with these headers, which may repeat, and expects the status, as documented."""
    path = template.format(id='engine', name='x', frame='0', measure='x', volume='x') + query
    connection = http.client.HTTPConnection(daemon.host, timeout=contract_test.DEADLINE_S)
    connection.putrequest(method.upper(), path)
    for name, value in (('Authorization', f'Bearer {token or daemon.token}'), ('Content-Length', '0'), *headers):
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    check(answer.status == status, f'{method.upper()} {path[:100]}: {answer.status}, expected {status}: {data[:200]}')
    if status == 405:
        allowed = {m.strip().lower() for m in answer.headers.get('Allow', '').split(',')} - {'head'}
        check(allowed == contract.document['paths'][template].keys() & {'get', 'post', 'put', 'patch', 'delete', 'options'},
              f'{method.upper()} {template}: Allow: {answer.headers.get("Allow")}')
        for error in jsonschema.Draft202012Validator(contract.document['components']['schemas']['Problem']).iter_errors(json.loads(data)):
            check(False, f'{method.upper()} {template}: 405: {error.message}')
    else:
        contract.check(method, template, answer.status, answer.headers, data)
    if status in (429, 503):
        check(answer.headers.get('Retry-After', '').isdigit(), f'{method.upper()} {template}: {status} without Retry-After')


def whatever_is_asked(program, contract):
    """Checks that every operation can answer 400, 403, 405, 414, 429 and 503."""
    operations_ = list(all_operations(contract.document))
    with tempfile.NamedTemporaryFile('w') as tokens:
        tokens.write('admin-0123456789ab\nmetrics-0123456789ab role=metrics\nview-0123456789ab role=view\n')
        tokens.flush()
        daemon = Daemon(program, '--token-file', tokens.name, token='admin-0123456789ab')
    for template, method, secured in operations_:
        refused(daemon, contract, 400, template, method, [('Host', 'a')])
        refused(daemon, contract, 414, template, method, query='?' + 'x' * 9000)
        if secured:
            role = 'view' if template == '/metrics' else 'metrics'
            refused(daemon, contract, 403, template, method, token=f'{role}-0123456789ab')
    for template, item in contract.document['paths'].items():
        for method in {'get', 'post', 'put', 'patch', 'delete', 'trace'} - item.keys():
            refused(daemon, contract, 405, template, method)
    status, _, _ = daemon.ask('GET', '/readyz', headers={'X': 'x' * 40000})
    check(status == 431, f'headers over their limit: {status}')
    check(daemon.stop()[0] == 0, 'splatd did not exit with 0')
    for status, limit in ((429, '--connections-per-address'), (503, '--connections')):
        daemon = Daemon(program, limit, '1')
        first = http.client.HTTPConnection(daemon.host, timeout=contract_test.DEADLINE_S)
        first.request('GET', '/healthz')
        first.getresponse().read()
        for template, method, _ in operations_:
            refused(daemon, contract, status, template, method)
        first.close()
        check(daemon.stop()[0] == 0, 'splatd did not exit with 0')


def check_coverage(contract):
    for template, method, _ in all_operations(contract.document):
        for status in contract.document['paths'][template][method]['responses']:
            seen = (method, template, status) in contract.statuses
            check(seen or ELSEWHERE & {status, (method, template, status)},
                  f'{method.upper()} {template}: {status} is documented but never occurred')


def main():
    seed = int(os.environ.get('SPLATD_SEED', 1))
    rng = random.Random(seed)
    contract = Contract(f'{sys.argv[2]}/protocol')
    daemon = Daemon(sys.argv[1], '--sessions', '60', '--views', '60', '--memory', '8M')
    try:
        walk(daemon, contract)
        bring_about(daemon, contract)
        caller = Caller(daemon, contract, rng)
        for _ in range(REQUESTS):
            for template, method in operations(contract.document):
                caller.call(template, method)
        status, _, _ = daemon.ask('GET', '/readyz')
        check(status == 200, 'the daemon is no longer ready')
    finally:
        status, log = daemon.stop()
    check(status == 0, f'splatd ended with {status}: {log[-2000:]}')
    check('Sanitizer' not in log and 'runtime error' not in log, log[-4000:])
    whatever_is_asked(sys.argv[1], contract)
    check_coverage(contract)
    print(f'seed {seed}, {REQUESTS} requests for each operation, {len(contract.statuses)} statuses, {contract_test.failures} failures')
    return 1 if contract_test.failures else 0


if __name__ == '__main__':
    sys.exit(main())
