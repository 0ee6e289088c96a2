// SPDX-License-Identifier: Apache-2.0
// Volumes that are larger than memory: first and complete picture, bytes read and peak memory, against the size of the volume.
//   node tests/bench/bricks.mjs FOLDER [SIDE...]     brick files vessels-SIDE.bricks are made in FOLDER if they are missing
// SPLATD_BIN_DIR is the folder of the programs, SPLATD_MEMORY the budget (512M). Prints CSV. 2048³ takes minutes to make, and 16 GiB of disk while it is made.
import { execFileSync } from 'node:child_process';
import { existsSync, readFileSync } from 'node:fs';
import path from 'node:path';
import { BIN, Daemon, FINAL } from '../integration/harness.mjs';

const [folder, ...sides] = process.argv.slice(2);
const MEMORY = process.env.SPLATD_MEMORY ?? '512M';
const proc = (daemon, file, key) => Number(new RegExp(`^${key}:\\s+(\\d+)`, 'm').exec(readFileSync(`/proc/${daemon.child.pid}/${file}`, 'utf8'))[1]);

function convert(name, side) {
  if (existsSync(path.join(folder, name))) return;
  execFileSync(path.join(BIN, 'splatctl'), ['convert', '--timeout', '3600', `demo:vessels?size=${side}`, path.join(folder, name)]);
}

/** Opens a stream of a new session: the first frame, the final one, and what was read for them [ms, bytes]. */
async function watch(daemon, view) {
  const before = proc(daemon, 'io', 'rchar');
  const session = await daemon.session(view);
  const start = performance.now();
  const stream = await daemon.stream({ session });
  await stream.until(() => stream.frames[0], 'the first frame');
  const first = performance.now() - start;
  await stream.until(() => stream.frames.find(({ flags }) => flags & FINAL), 'the final frame');
  const complete = performance.now() - start;
  const isNewest = ({ method, params: { bricks } }) => method === 'stream.stats' && bricks?.wanted > 0 && bricks.resident === bricks.wanted;
  const { bricks } = (await stream.until(() => stream.notes.findLast(isNewest), 'the numbers of the final frame')).params;
  await stream.end();
  return { ...bricks, first, complete, read: proc(daemon, 'io', 'rchar') - before };
}

console.log('side,memory,view,size,load_ms,first_ms,complete_ms,level,bricks,read_bytes,peak_bytes');
for (const side of sides.length ? sides.map(Number) : [512, 1024]) {
  const name = `vessels-${side}.bricks`;
  convert(name, side);
  const daemon = await Daemon.start(['--data', folder, '--memory', MEMORY, '--frame-size', '1920x1080'], { backend: 'cpu' });
  const start = performance.now();
  await daemon.post('/api/v1/volumes', { path: name, id: 'v' });
  await daemon.loaded('v');
  const load = performance.now() - start;
  const { json: view } = await daemon.json('/api/v1/volumes/v/view');
  const near = structuredClone(view.camera);
  near.position = near.position.map((p, i) => near.target[i] + (p - near.target[i]) / 6);
  for (const [what, size, camera] of [['default', [512, 512], view.camera], ['default', [1920, 1080], view.camera], ['near', [1920, 1080], near]]) {
    const got = await watch(daemon, { volume: 'v', size, camera });
    console.log([side, MEMORY, what, size.join('x'), load.toFixed(0), got.first.toFixed(0), got.complete.toFixed(0), got.level, got.resident, got.read,
      proc(daemon, 'status', 'VmHWM') * 1024].join(','));
  }
  await daemon.stop();
}
