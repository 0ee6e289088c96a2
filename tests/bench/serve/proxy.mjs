// SPDX-License-Identifier: Apache-2.0
// A TCP proxy that behaves like a slow and distant network: a delay, a rate, and stalls.
//
//   client ──► delay ──► daemon          up:   the delay alone
//          ◄── delay ◄── rate, queue ◄── down: each packet leaves when the previous packet has left
//
// The queue is bounded, apart from the buffers of the kernel.
//
// A stall stands for a lost packet: it arrives one round trip later, when it was sent again, and the later packets are delivered
// after it. They use the link meanwhile.
import { once } from 'node:events';
import net from 'node:net';

const PACKET = 1460; // bytes of a TCP segment
const QUEUE_BYTES = 128 * 1024; // that wait to leave, as in a home router

/** One direction of a connection. `bytesPerMs` may be Infinity. */
class Link {
  #from; #to; #delayMs; #bytesPerMs; #stallMs; #stalls; #random;
  #queue = [];
  #freeMs = 0; // when the newest packet has left the bottleneck
  #lastMs = 0; // when it arrives
  #timer = null;

  constructor(from, to, { delayMs, bytesPerMs = Infinity, stalls = 0, stallMs = 0, random }) {
    [this.#from, this.#to, this.#delayMs, this.#bytesPerMs] = [from, to, delayMs, bytesPerMs];
    [this.#stalls, this.#stallMs, this.#random] = [stalls, stallMs, random];
    from.on('data', (data) => this.#put(data));
    from.on('end', () => this.#end());
    from.on('error', () => to.destroy());
  }

  #put(data) {
    for (let at = 0; at < data.length; at += PACKET) {
      const packet = data.subarray(at, at + PACKET);
      const now = performance.now();
      this.#freeMs = Math.max(this.#freeMs, now) + packet.length / this.#bytesPerMs;
      const stallMs = this.#random() < this.#stalls ? this.#stallMs : 0;
      this.#lastMs = Math.max(this.#lastMs, this.#freeMs + this.#delayMs + stallMs);
      this.#queue.push({ packet, dueMs: this.#lastMs });
    }
    const fullMs = this.#freeMs - performance.now() - QUEUE_BYTES / this.#bytesPerMs;
    if (fullMs > 0) {
      this.#from.pause();
      setTimeout(() => this.#from.resume(), fullMs);
    }
    this.#arm();
  }

  #end() {
    this.#queue.push({ packet: null, dueMs: Math.max(this.#lastMs, performance.now() + this.#delayMs) });
    this.#arm();
  }

  #arm() {
    if (this.#timer || this.#queue.length === 0) return;
    const waitMs = this.#queue[0].dueMs - performance.now();
    // Timers have a resolution of 1 ms; the last part of a wait is spent in the event loop.
    this.#timer = waitMs > 1 ? setTimeout(() => this.#release(), waitMs - 1) : setImmediate(() => this.#release());
  }

  #release() {
    this.#timer = null;
    const now = performance.now();
    while (this.#queue.length && this.#queue[0].dueMs <= now) {
      const { packet } = this.#queue.shift();
      if (packet) this.#to.write(packet);
      else this.#to.end();
    }
    this.#arm();
  }
}

/** Starts a proxy to a port of this machine. `mbit`: rate to the client in Mbit/s; `stalls`: share of packets that stall. Returns
 * {port, close()}. The stalls are the same in every run. */
export async function startProxy(port, { rttMs = 0, mbit = Infinity, stalls = 0 }) {
  const sockets = new Set();
  let seed = 1;
  const random = () => {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    return seed / 2 ** 32;
  };
  const server = net.createServer({ noDelay: true }, (client) => {
    const daemon = net.connect({ port, host: '127.0.0.1', noDelay: true });
    for (const socket of [client, daemon]) {
      sockets.add(socket);
      socket.on('close', () => sockets.delete(socket));
    }
    const shared = { delayMs: rttMs / 2, random };
    new Link(client, daemon, shared);
    new Link(daemon, client, { ...shared, bytesPerMs: mbit * 125, stalls, stallMs: Math.max(rttMs, 10) });
  });
  server.listen(0, '127.0.0.1');
  await once(server, 'listening');
  return {
    port: server.address().port,
    close() {
      sockets.forEach((socket) => socket.destroy());
      server.close();
    },
  };
}
