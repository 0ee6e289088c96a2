// SPDX-License-Identifier: Apache-2.0
// Remote OME-Zarr over HTTPS: from hosts with a certificate that is trusted, and from no others.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import https from 'node:https';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { certify } from './certificate.mjs';
import { BIN, Daemon } from './harness.mjs';

const skip = !existsSync(path.join(BIN, 'splat-fetch')) && 'built without libcurl';
const servers = {};
let daemon;
let folder;

/** Serves files of the folder as a whole. */
function answer(request, response) {
  const file = path.join(folder, new URL(request.url, 'https://x').pathname);
  const bytes = existsSync(file) && readFileSync(file);
  response.writeHead(bytes ? 200 : 404);
  response.end(bytes || undefined);
}

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-remote-tls-'));
  execFileSync(path.join(BIN, 'splatctl'), ['convert', 'demo:noise?size=32', path.join(folder, 'v.zarr')]);
  for (const name of ['trusted', 'unknown']) {
    const prefix = path.join(folder, name);
    certify(prefix, name);
    servers[name] = https.createServer({ cert: readFileSync(`${prefix}.crt`), key: readFileSync(`${prefix}.key`) }, answer);
    await new Promise((ready) => { servers[name].listen(0, '127.0.0.1', ready); });
  }
  const hosts = Object.values(servers).map((server) => `127.0.0.1:${server.address().port}`);
  daemon = await Daemon.start(['--allow-host', hosts.join()], { env: { SSL_CERT_FILE: path.join(folder, 'trusted.crt') } });
});
after(async () => {
  const status = await daemon?.stop();
  for (const server of Object.values(servers)) {
    server.closeAllConnections();
    server.close();
  }
  rmSync(folder, { recursive: true });
  assert.equal(status, 0);
});

const load = async (name, id) => {
  const source = `https://127.0.0.1:${servers[name].address().port}/v.zarr`;
  assert.equal((await daemon.post('/api/v1/volumes', { source, id })).status, 202);
  return daemon.loaded(id);
};

test('a host with a trusted certificate is read', { skip }, async () => {
  const loaded = await load('trusted', 'one');
  assert.equal(loaded.state, 'ready', JSON.stringify(loaded));
});

test('a host with another certificate is refused', { skip }, async () => {
  const loaded = await load('unknown', 'two');
  assert.equal(loaded.state, 'failed');
  assert.match(JSON.stringify(loaded), /certificate/);
});
