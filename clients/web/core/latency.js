// SPDX-License-Identifier: Apache-2.0
// Where the time between an action of the user and its picture goes, and whether the daemon is overloaded.

export const PARTS = ['network', 'queue', 'render', 'encode', 'browser'];

/**
 * Splits `total` ms. frame: the header, with queueUs, renderUs and encodeUs, and its bytes; waited: ms in the page before the update was
 * sent; decode: ms from the arrival of the frame to its drawing; link: {rtt_ms, bandwidth} of stream.stats. What remains is the network, as
 * far as the link explains it; the rest is the wait for this browser, which took the frame late. Scales the parts where they exceed the
 * total, because a picture from the frame cache states the render time of its first rendering.
 */
export function splitLatency(total, frame, { waited = 0, decode = 0, link = {} } = {}) {
  const parts = {
    queue: waited + frame.queueUs / 1000, render: frame.renderUs / 1000, encode: frame.encodeUs / 1000, browser: decode,
  };
  const sum = Object.values(parts).reduce((a, b) => a + b, 0);
  if (sum > total) return { network: 0, ...Object.fromEntries(Object.entries(parts).map(([name, ms]) => [name, ms * total / sum])) };
  const rest = total - sum;
  const network = link.bandwidth > 0 ? Math.min(rest, link.rtt_ms + 1000 * frame.bytes / link.bandwidth) : rest;
  return { ...parts, network, browser: decode + rest - network };
}

/** The mean of the newest splits: smooths the figures of the panel. */
export class LatencyMeter {
  #newest = []; // {time, total, parts}

  put(time, total, parts) {
    this.#newest.push({ time, total, parts });
    if (this.#newest.length > 32) this.#newest.shift();
  }

  clear() {
    this.#newest = [];
  }

  /** {total, network, queue, …} of the last `span` ms before the newest, in ms; null if nothing was measured. */
  mean(span = 1000) {
    const last = this.#newest.at(-1);
    if (!last) return null;
    const recent = this.#newest.filter(({ time }) => last.time - time <= span);
    const mean = (of) => recent.reduce((sum, entry) => sum + of(entry), 0) / recent.length;
    return { total: mean(({ total }) => total), ...Object.fromEntries(PARTS.map((name) => [name, mean(({ parts }) => parts[name])])) };
  }
}

const QUEUE_LONG_MS = 250;
/** Reasons of stream.policy that the user can do something about, the most important first. */
const REDUCTIONS = ['bandwidth', 'shared_time', 'time', 'video_pixels'];
/** The reasons that lower the detail, not only the quality of the encoding. */
const DETAIL = new Set(['shared_time', 'time']);

/** What takes the largest part of the latency: 'network', 'renderer' or 'browser', with its ms. */
export function limitOf({ network, render, encode, browser }) {
  return Object.entries({ network, renderer: render + encode, browser }).reduce((most, one) => (one[1] > most[1] ? one : most));
}

/** True if the network, not the work on pictures, limits them; the daemon's reason alone is of a moment ago. */
export const isNetworkSlow = (policy, latency) => Boolean(policy?.why?.includes('bandwidth') && latency
  && latency.network > latency.render + latency.encode + latency.browser);

/** The policy, without the reason "bandwidth" if the network is not the limit. */
export function judged(policy, latency) {
  return !policy?.why || isNetworkSlow(policy, latency) ? policy : { ...policy, why: policy.why.filter((reason) => reason !== 'bandwidth') };
}

/**
 * What to tell about a slow picture: 'offline', 'busy' (the daemon refused with 429 or 503), 'queue' (pictures wait for a renderer),
 * 'browser' (this page takes them late), a reason of stream.policy why quality is reduced, or null. isMoving: the newest picture is one of a moving view; detail: its detail in
 * percent (detail.js), which says whether a reason has lowered it.
 */
export function overloadOf({ isOnline = true, error = null, latency = null, policy = null, isMoving = false, detail = 100 }) {
  if (!isOnline) return 'offline';
  if (error?.status === 503 || error?.status === 429) return 'busy';
  if (isMoving && latency && latency.queue > QUEUE_LONG_MS) return 'queue';
  if (!isMoving) return null;
  const isReduced = detail < 100;
  const reason = REDUCTIONS.find((one) => judged(policy, latency)?.why?.includes(one) && (isReduced || !DETAIL.has(one))) ?? null;
  if (reason || !isReduced || !policy?.why?.includes('bandwidth')) return reason;
  return latency && limitOf(latency)[0] === 'browser' ? 'browser' : 'time';
}
