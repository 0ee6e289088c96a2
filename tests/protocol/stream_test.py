#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests the daemon's streams with calls that are generated from stream.schema.json.

  stream_test.py SPLATD SOURCE_DIR

Three participants of a session call every method many times, with valid and invalid params. The schema must describe every
answer and every notification. SPLATD_SEED and SPLATD_REQUESTS work as in generated_test.py. Exit status 77: skipped.
"""
import json
import os
import random
import sys

import contract_test
from contract_test import Contract, Daemon, check
from generate import Values
from stream_client import Stream

REQUESTS = int(os.environ.get('SPLATD_REQUESTS', 300))
PARAMS = -32602
# Errors that params may cause although the schema allows them.
BEYOND = {
    'view.update': {-32000, -32001, -32002, -32003, -32004, -32007},
    'session.request_control': {-32004}, 'session.grant_control': {PARAMS, -32007}, 'session.refuse_control': {PARAMS, -32007},
    'pick': {PARAMS, -32005}, 'measure.put': {PARAMS, -32002, -32004, -32005}, 'measure.remove': {-32002, -32004, -32005}, 'stream.ack': {PARAMS}, 'stream.configure': {PARAMS},
    'time.play': {-32000, -32004, -32007}, 'time.stop': {-32004, -32007},
}
OPAQUE = {'transfer_function': {'points': [{'value': 0, 'color': [1, 1, 1], 'opacity': 0.9}]}}
# Only a failing renderer causes it: integration.stream tests it.
ELSEWHERE = {'render.error'}


class StreamContract(Contract):
    def __init__(self, folder):
        super().__init__(folder)
        with open(f'{folder}/stream.schema.json', encoding='utf-8') as f:
            text = f.read().replace('#/$defs/', '#/components/schemas/Stream/$defs/')
        stream = json.loads(text.replace('"view.schema.json"', '"#/components/schemas/View"'))
        self.document['components']['schemas']['Stream'] = stream
        self.methods, self.notifications = stream['$defs']['methods'], stream['$defs']['notifications']

    def holds(self, values, name, schema, value):
        for error in list(values.validator(schema).iter_errors(value))[:2]:
            check(False, f'{name}: {"/".join(map(str, error.path))}: {error.message[:300]}')


def call(contract, values, stream, method, rng):
    schema = contract.methods[method]['params']
    params = values.valid(schema)
    if rng.random() < 0.4:
        params = values.broken(params, schema)
    if isinstance(params, dict) and isinstance(params.get('size'), list):
        params['size'] = params['size'] and [min(n, 64) if isinstance(n, int) else n for n in params['size']]
    if method == 'pick' and rng.random() < 0.7:
        params = {'at': [rng.uniform(0, 16), rng.uniform(0, 16)]}
    if method == 'time.play' and rng.random() < 0.5:  # few random views show the vectors that it needs
        stream.ask({'method': 'view.update', 'params': {'seq': 1, 'patch': {'volume': 'tornado', 'layers': [{'type': 'vectors'}]}}})
        params = {'rate': rng.choice([-2, 0.5, 10])}  # its volume has one time step
    if method == 'measure.put' and rng.random() < 0.7:  # few random points fit their kind
        params = {'id': rng.choice(['a', 'C_2']), 'kind': 'marker', 'points': [[rng.uniform(0, 16) for _ in range(3)]]}
    is_sound = values.validator(schema).is_valid(params)
    answer = stream.ask({'method': method, 'params': params})
    what = f'{method} {json.dumps(params)[:300]} → {json.dumps(answer)[:300]}'
    if 'result' in answer:
        contract.holds(values, what, {'$ref': '#/components/schemas/Stream/$defs/result'}, answer)
        contract.holds(values, what, contract.methods[method]['result'], answer['result'])
        check(is_sound, f'invalid params are accepted: {what}')
    else:
        contract.holds(values, what, {'$ref': '#/components/schemas/Stream/$defs/error'}, answer)
        code = answer['error']['code']
        pointer = answer['error'].get('data', {}).get('pointer')
        may_refuse = method != 'stream.configure' or pointer == '/name' or (pointer, params.get('format')) == ('/format', 'h264')
        check(not is_sound or may_refuse, f'valid params are refused: {what}')
        # Params that are not an object make an invalid request.
        check(code in (BEYOND.get(method, set()) if is_sound else BEYOND.get(method, set()) | {PARAMS, -32600}), f'an undocumented error: {what}')
    return 'result' in answer


def hand_over(stream, taken):
    """Requests control until the holder's time is up, then grants and refuses: random calls are seldom in time."""
    stream.note('session.participants')
    me = next(note for note in stream.notes if note['method'] == 'session.participants')['params']['you']
    methods = {'session.grant_control', 'session.refuse_control'}
    while not methods <= taken:
        stream.ask({'method': 'session.request_control'})
        taken |= {method for method in methods if 'result' in stream.ask({'method': method, 'params': {'to': me}})}


def check_notes(contract, values, streams):
    seen = set()
    for stream in streams:
        for note in stream.notes:
            method = note['method']
            seen.add(method)
            contract.holds(values, method, {'$ref': '#/components/schemas/Stream/$defs/call'}, note)
            check(method in contract.notifications, f'{method} is not described')
            contract.holds(values, method, contract.notifications.get(method, {}), note.get('params', {}))
    check(seen | ELSEWHERE == set(contract.notifications), f'these notifications never came: {set(contract.notifications) - seen}')


def main():
    seed = int(os.environ.get('SPLATD_SEED', 1))
    rng = random.Random(seed)
    contract = StreamContract(f'{sys.argv[2]}/protocol')
    values = Values(contract.document, rng)
    # Control passes on quickly, so that all participants change the view now and then.
    daemon = Daemon(sys.argv[1], '--control-time', '0.05')
    streams, taken = [], set()
    try:
        while json.loads(daemon.ask('GET', '/api/v1/volumes/engine')[2])['state'] == 'loading':
            pass
        daemon.ask('POST', '/api/v1/volumes', {'uri': 'demo:tornado?size=16', 'id': 'tornado'})
        while json.loads(daemon.ask('GET', '/api/v1/volumes/tornado')[2])['state'] == 'loading':
            pass
        session = json.loads(daemon.ask('POST', '/api/v1/sessions', {'view': {'size': [16, 16], **OPAQUE}})[2])
        streams = [Stream(daemon.host, session['id'], session['tokens'][role]) for role in ('control', 'control', 'view')]
        for stream in streams:
            stream.ask({'method': 'stream.configure', 'params': {'size': [16, 16]}})
        hit = streams[0].ask({'method': 'pick', 'params': {'at': [8, 8]}})['result']
        contract.holds(values, f'a hit: {hit}', contract.methods['pick']['result'], hit)
        check(hit['position'], f'a pick in the middle hits nothing: {hit}')
        for _ in range(REQUESTS):
            for method in contract.methods:
                if call(contract, values, rng.choice(streams), method, rng):
                    taken.add(method)
        hand_over(streams[0], taken)
        check(taken == set(contract.methods), f'these methods never succeeded: {set(contract.methods) - taken}')
        unknown = streams[0].ask({'method': 'view.explode'})
        check(unknown['error']['code'] == -32601, f'an unknown method: {unknown}')
        daemon.ask('POST', '/api/v1/volumes', {'uri': 'demo:phantom?size=8'})
        for method in sorted(set(contract.notifications) - ELSEWHERE - {'server.draining', 'view.changed'}):
            streams[0].note(method)
    finally:
        daemon.process.terminate()
        for stream in streams:
            stream.end()
        status, log = daemon.wait()
    check(status == 0, f'splatd ended with {status}: {log[-2000:]}')
    check('Sanitizer' not in log and 'runtime error' not in log, log[-4000:])
    check([stream.closed for stream in streams] == [1001] * 3, f'closed with {[stream.closed for stream in streams]}')
    check_notes(contract, values, streams)
    print(f'seed {seed}, {REQUESTS} calls of each method, {contract_test.failures} failures')
    return 1 if contract_test.failures else 0


if __name__ == '__main__':
    sys.exit(main())
