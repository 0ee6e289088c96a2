// SPDX-License-Identifier: Apache-2.0
// One file on its way to the daemon, in parts. After a lost connection it asks the daemon how much arrived and continues there.
//
//   idle ─► starting ─► sending ─► sent
//              ▲           │  └─► paused ─► starting
//              └─ waiting ◄┘ (no connection; tries again)        any ─► failed (resume() tries again) or cancelled
import { Emitter } from './emitter.js';
import { sizeTexts } from './files.js';
import { t } from './text.js';

const PART_FIRST = 1 << 20;
const PART_MIN = 1 << 18;
const PART_MAX = 1 << 24;
const PART_FAST_MS = 300; // a part that takes less is followed by a larger one
const PART_SLOW_MS = 1500;
const RETRY_FIRST_MS = 500;
const RETRY_MAX_MS = 10000;
const MISMATCHES_MAX = 3;
const RATE_WINDOW_MS = 5000;
const PASSING = new Set([0, 408, 500, 502, 503, 504]);

/** Events: change (the upload). */
export class Upload extends Emitter {
  #api; #env; #header; #timer = null;
  #abort = null;
  #epoch = 0;
  #part = PART_FIRST;
  #failures = 0;
  #mismatches = 0;
  #steps = []; // [ms, bytes] of the last seconds
  state = 'idle';
  id = null;
  sent = 0;
  /** The ApiError that made it fail or wait; null = none. */
  error = null;
  /** What the daemon takes: {most, free, own} in bytes, {files} that it still takes; null if it did not fail because of these. */
  limits = null;

  /**
   * file: a Blob with a name; api(): the Api; id: of an upload that was begun before, or null; header: the upload of the header that
   * names this file, or null; env: {setTimeout, clearTimeout, now, checksum(bytes) → text of Upload-Checksum or '', as a promise}.
   */
  constructor({ file, api, id = null, header = null, env }) {
    super();
    this.file = file;
    this.#api = api;
    this.#env = env;
    this.#header = header;
    this.id = id;
  }

  get name() { return this.file.name; }
  get bytes() { return this.file.size; }
  get isActive() { return ['starting', 'sending', 'waiting'].includes(this.state); }

  /** Bytes per second over the last seconds; 0 = not known. */
  get rate() {
    const [first] = this.#steps;
    const last = this.#steps.at(-1);
    return this.state === 'sending' && last && last[0] > first[0] ? (last[1] - first[1]) / (last[0] - first[0]) * 1000 : 0;
  }

  /** Seconds that the rest will take; null = not known. */
  get secondsLeft() {
    return this.rate > 0 ? (this.bytes - this.sent) / this.rate : null;
  }

  /** Starts, or continues after pause(), a failure or a wait. */
  resume() {
    if (!['idle', 'paused', 'failed', 'waiting'].includes(this.state)) return;
    this.#stop();
    this.#mismatches = 0;
    this.#set('starting');
    this.#run(this.#epoch);
  }

  pause() {
    if (!this.isActive) return;
    this.#stop();
    this.#set('paused');
  }

  /** Ends it and has the daemon forget what arrived. */
  cancel() {
    if (['sent', 'cancelled'].includes(this.state)) return;
    this.#stop();
    if (this.id) this.#api().deleteUpload(this.id).catch(() => {}); // it expires otherwise
    this.#set('cancelled');
  }

  #stop() {
    this.#epoch += 1;
    this.#abort?.abort();
    this.#abort = null;
    this.#env.clearTimeout(this.#timer);
    this.#steps = [];
  }

  #set(state, error = null) {
    this.state = state;
    this.error = error;
    this.emit('change', this);
  }

  async #run(epoch) {
    try {
      await this.#locate(epoch);
      while (epoch === this.#epoch && this.sent < this.bytes) await this.#send(epoch);
      if (epoch === this.#epoch) this.#set('sent');
    } catch (error) {
      if (epoch === this.#epoch) this.#failed(error);
    }
  }

  /** Begins the upload, or asks where to continue. */
  async #locate(epoch) {
    if (this.id) {
      try {
        const { offset } = await this.#api().upload(this.id);
        if (epoch === this.#epoch) this.#arrived(offset);
        return;
      } catch (error) {
        if (error.status !== 404) throw error;
        this.id = null; // it expired: from the beginning
      }
    }
    const { id } = await this.#api().createUpload(this.file, this.#header);
    if (epoch === this.#epoch) {
      this.id = id;
      this.#arrived(0);
    } else {
      this.#api().deleteUpload(id).catch(() => {});
    }
  }

  #arrived(offset) {
    this.sent = offset;
    this.#steps.push([this.#env.now(), offset]);
    while (this.#steps.length > 2 && this.#steps.at(-1)[0] - this.#steps[0][0] > RATE_WINDOW_MS) this.#steps.shift();
    this.#set('sending');
  }

  async #send(epoch) {
    const part = this.file.slice(this.sent, this.sent + this.#part);
    const checksum = await this.#env.checksum(part);
    if (epoch !== this.#epoch) return;
    this.#abort = new AbortController();
    const began = this.#env.now();
    const offset = await this.#api().sendPart(this.id, this.sent, part, { checksum, signal: this.#abort.signal });
    if (epoch !== this.#epoch) return;
    const took = this.#env.now() - began;
    if (took < PART_FAST_MS) this.#part = Math.min(PART_MAX, this.#part * 2);
    else if (took > PART_SLOW_MS) this.#part = Math.max(PART_MIN, this.#part / 2);
    this.#failures = 0;
    this.#mismatches = 0;
    this.#arrived(offset);
  }

  #failed(error) {
    const status = error.status ?? 0; // fetch() fails with a TypeError
    const isWrong = (status === 409 || status === 460) && this.#mismatches < MISMATCHES_MAX;
    if (isWrong) { // the daemon has another offset, or bytes changed on their way
      this.#mismatches += 1;
      this.#set('starting');
      this.#run(this.#epoch);
    } else if (PASSING.has(status)) {
      const wait = Math.min(RETRY_MAX_MS, RETRY_FIRST_MS * 2 ** this.#failures);
      this.#failures += 1;
      this.#steps = [];
      this.#set('waiting', error);
      this.#timer = this.#env.setTimeout(() => this.resume(), wait);
    } else {
      this.#refused(error, this.#epoch);
    }
  }

  async #refused(error, epoch) {
    this.limits = null;
    if (error.status === 413 || error.status === 507) {
      try {
        const { bytes_max: most, bytes_free: free, bytes: own, uploads_free: files } = await this.#api().uploads();
        this.limits = { most, free, own, files };
      } catch { /* the text of the daemon has to do */ }
    }
    if (epoch === this.#epoch) this.#set('failed', error);
  }
}

/** Why an upload failed, for a person. */
export function refusalText({ bytes, error, limits }) {
  if (bytes > limits?.most) {
    const [size, most] = sizeTexts(bytes, limits.most);
    return t('upload.large', { size, most });
  }
  if (limits?.files === 0) return t('upload.many');
  if (bytes > limits?.free) {
    const [size, free] = sizeTexts(bytes, limits.free);
    return t(limits.own > 0 ? 'upload.full' : 'upload.full.others', { size, free });
  }
  return error?.message ?? ''; // there is space by now, or the daemon has another reason
}
