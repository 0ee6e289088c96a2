// SPDX-License-Identifier: Apache-2.0
// Hostile client behaviours. Each runs in its own process, so that it loads the daemon and not the process that measures.
//
//   node hostile.mjs KIND '{"port": …, "token": …, "secure": …, "victim": {"id": …, "tokens": …}}'
//
// Prints a line when it has started, and on SIGTERM how often it was served: frames, answers or handshakes. The daemon has three
// volumes: the victim's volume and two large volumes.
import { once } from 'node:events';
import net from 'node:net';
import tls from 'node:tls';
import { fileURLToPath } from 'node:url';
import { Client, Daemon, pause } from './peers.mjs';

const HASTE_MS = 20; // between two changes during a drag
const MANY_STREAMS = 24; // streams per client
const ASKING_STREAMS = 16;
const MANY_MEASURES = 100; // the most that a session has
const MEASURE_MS = 55; // between two changes of measurements: the daemon allows 20 per second
const SLOW = { size: [4096, 4096], format: 'png', quality: 100, max_fps: 60 };
const SURFACES = 7;
const clients = [];
let served = 0;

/** Opens a stream of a new session. */
async function join(daemon, { px = 512, volume = 0, ...options } = {}) {
  clients.push(await Client.open(daemon, await daemon.session(px, daemon.views[volume]), options));
  return clients.at(-1);
}

/** Repeats `act` in `times` parallel loops; a refused call is repeated after a short pause. */
function again(times, act) {
  const count = () => { served++; };
  for (let i = 0; i < times; i++) (async () => { for (;;) await act().then(count, () => pause(10)); })();
}

/** Asks on many streams of one session, which only watch, for the answer to `method`: each the next time when it has come. */
async function askOnStreams(daemon, session, method) {
  for (let i = 0; i < ASKING_STREAMS; i++) clients.push(await Client.open(daemon, session, { role: 'view' }));
  for (const { socket } of clients) {
    const ask = () => socket.send(JSON.stringify({ jsonrpc: '2.0', id: 1, method }));
    socket.on('message', (data, isBinary) => {
      if (isBinary || !String(data).includes('"id":1')) return;
      served++;
      ask();
    });
    ask();
  }
}

/** Resolves to the first message of a TLS client. */
async function greeting() {
  const server = net.createServer().listen(0, '127.0.0.1');
  await once(server, 'listening');
  const client = tls.connect({ port: server.address().port, host: '127.0.0.1', ecdhCurve: 'P-256' }).on('error', () => {});
  const [socket] = await once(server, 'connection');
  const [hello] = await once(socket, 'data');
  [client, socket, server].forEach((one) => (one.destroy ?? one.close).call(one));
  return hello;
}

export const plain = {
  'slow to acknowledge': async (daemon) => (await join(daemon, { delay: 500 })).drive(),
  'stalled, and reads nothing': async (daemon) => {
    const client = await join(daemon, { delay: Infinity });
    client.drive();
    client.socket._socket.pause();
  },
  'flooding with messages': async (daemon) => {
    const client = await join(daemon, { delay: Infinity });
    const send = () => {
      while (client.socket.bufferedAmount < 1e6) client.turn();
      client.sent.clear();
      setImmediate(send);
    };
    send();
  },
  [`flooding with large messages that are refused, on ${MANY_STREAMS} streams`]: async (daemon) => {
    const session = await daemon.session(512);
    for (let i = 0; i < MANY_STREAMS; i++) clients.push(await Client.open(daemon, session, { role: 'view' }));
    const text = JSON.stringify({ jsonrpc: '2.0', method: 'view.update', params: { seq: 1, patch: { x: Array(30000).fill(0) } } });
    setInterval(() => {
      for (const { socket } of clients) while (socket.bufferedAmount < 2e5) socket.send(text);
    }, HASTE_MS);
  },
  [`asking for ${MANY_MEASURES} measurements, on ${ASKING_STREAMS} streams`]: async (daemon) => {
    const session = await daemon.session(512);
    const measure = (i) => ({ kind: 'distance', points: [[0, 0, 0], [1, i, 0]], text: `measurement ${i}` });
    for (let i = 0; i < MANY_MEASURES; i++) {
      await daemon.ask('PUT', `sessions/${session.id}/measures/m${i}`, measure(i));
      await pause(MEASURE_MS);
    }
    await askOnStreams(daemon, session, 'measure.list');
  },
  [`asking for the view, on ${ASKING_STREAMS} streams`]: async (daemon) => askOnStreams(daemon, await daemon.session(512), 'view.get'),
  'flooding with requests': async (daemon) => again(4, () => daemon.ask('GET', 'volumes')),
  'flooding with pictures': async (daemon) => again(4, () => daemon.ask('POST', 'render', daemon.views[0])),
  'turning a large volume': async (daemon) => (await join(daemon, { volume: 1 })).drive(HASTE_MS),
  'dragging the transfer function of a large volume': async (daemon) => {
    const client = await join(daemon, { volume: 1 });
    const { points } = client.view.transfer_function;
    const step = (points.at(-1).value - points[0].value) / 1000;
    client.drive(HASTE_MS, () => client.update({
      transfer_function: { points: points.map((point) => ({ ...point, value: point.value + step * (client.seq % 50) })) },
    }));
  },
  'dragging the filter of a large volume': async (daemon) => {
    const client = await join(daemon, { volume: 1 });
    client.drive(HASTE_MS, () => client.update({
      filter: { sigma: 0.5 + 0.01 * (client.seq % 50), cutoff: 3 }, compositing: { mode: ['splat', 'sheet', 'slab'][client.seq % 3] },
    }));
  },
  'switching between large volumes': async (daemon) => {
    const client = await join(daemon, { volume: 1 });
    client.drive(HASTE_MS, () => client.update({ volume: daemon.views[1 + client.seq % 2].volume }));
  },
  'turning at 4096² as PNG': async (daemon) => {
    const client = await join(daemon, { volume: 1 });
    client.configure(SLOW);
    client.drive(HASTE_MS);
  },
  'turning at 4096² in final quality alone': async (daemon) => {
    const client = await join(daemon, { volume: 1 });
    client.configure({ ...SLOW, format: 'jpeg', progressive: false });
    client.drive(HASTE_MS);
  },
  'joining and leaving with another size': async (daemon) => {
    const session = await daemon.session(512, daemon.views[1]);
    let times = 0;
    again(1, async () => {
      const client = await Client.open(daemon, session);
      client.configure({ size: [500 + (++times % 20), 400] });
      await pause(50);
      client.end();
    });
  },
  'watching the same session at 4096² as PNG': async (daemon, victim) => {
    clients.push(await Client.open(daemon, victim, { role: 'view' }));
    clients[0].configure(SLOW);
  },
};

/** Costs the client almost nothing, and the daemon one signature each time. */
export const secure = {
  'beginning TLS handshakes': async (daemon) => {
    const hello = await greeting();
    const begin = () => {
      const socket = net.connect(daemon.port, '127.0.0.1', () => socket.write(hello));
      socket.on('error', () => {}).on('close', begin).once('data', () => {
        served++;
        socket.resetAndDestroy();
      });
    };
    for (let i = 0; i < 64; i++) begin();
  },
};

export const CROWD = 8;
export const HEAVY = 3;
/** Neighbours that are not hostile: beside them the victim gets a fair share, within the variation of the machine. */
export const others = {
  'a process that keeps a core busy, and asks for nothing': async () => {
    const burn = () => {
      const until = performance.now() + 10;
      while (performance.now() < until);
      setImmediate(burn);
    };
    burn();
  },
  [`${CROWD} sessions that turn a large volume`]: async (daemon) => {
    for (let i = 0; i < CROWD; i++) (await join(daemon, { volume: 1 })).drive();
  },
  [`${HEAVY} sessions that turn ${SURFACES} surfaces at 4096²`]: async (daemon) => {
    const { points } = daemon.views[1].transfer_function;
    const [low, high] = [points[0].value, points.at(-1).value];
    const layers = Array.from({ length: SURFACES }, (_, i) => ({ type: 'surface', value: low + (high - low) * (i + 1) / (SURFACES + 1), opacity: 0.4 }));
    for (let i = 0; i < HEAVY; i++) {
      const session = await daemon.session(4096, { ...daemon.views[1], layers });
      clients.push(await Client.open(daemon, session));
      clients.at(-1).configure({ size: [4096, 4096] });
      clients.at(-1).drive();
    }
  },
};

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const [kind, text] = process.argv.slice(2);
  const { victim, ...where } = JSON.parse(text);
  process.on('SIGTERM', () => {
    process.stdout.write(`${clients.reduce((all, client) => all + client.frames, served)}\n`, () => process.exit(0));
  });
  await { ...plain, ...secure, ...others }[kind](await new Daemon().look(where), victim);
  process.stdout.write('at work\n');
}
