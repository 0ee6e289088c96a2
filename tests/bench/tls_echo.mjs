// SPDX-License-Identifier: Apache-2.0
// Measures how long the TLS acceptor takes for a round trip of 4 MB and for a handshake. Prints CSV: what, median, slowest [ms].
//   node tls_echo.mjs BIN_DIR [rounds]
import { execFileSync, spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import tls from 'node:tls';

const [bin, rounds = 20] = [process.argv[2], Number(process.argv[3] ?? 20)];
const folder = mkdtempSync(path.join(tmpdir(), 'splat-tls-'));
const [cert, key] = ['cert.pem', 'key.pem'].map((name) => path.join(folder, name));
execFileSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:P-256', '-nodes', '-days', '2', '-subj', '/CN=bench',
  '-keyout', key, '-out', cert], { stdio: 'ignore' });
const server = spawn(path.join(bin, 'splat-tls-echo'), [cert, key], { stdio: ['pipe', 'pipe', 'inherit'] });
const port = Number(String((await once(server.stdout, 'data'))[0]));
const payload = Buffer.alloc(4 << 20, 'splat');

async function round() {
  const begin = performance.now();
  const socket = tls.connect({ port, host: '127.0.0.1', rejectUnauthorized: false });
  await once(socket, 'secureConnect');
  const open = performance.now();
  let got = 0;
  socket.write(payload);
  for await (const data of socket) if ((got += data.length) >= payload.length) break;
  return { handshake: open - begin, 'echo of 4 MiB': performance.now() - open };
}

await round(); // warm-up
const all = [];
for (let i = 0; i < rounds; i++) all.push(await round());
console.log('what,median_ms,slowest_ms');
for (const what of Object.keys(all[0])) {
  const times = all.map((r) => r[what]).sort((a, b) => a - b);
  console.log(`${what},${times[times.length >> 1].toFixed(1)},${times.at(-1).toFixed(1)}`);
}
server.stdin.end();
await once(server, 'close');
rmSync(folder, { recursive: true });
