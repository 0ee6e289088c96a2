// SPDX-License-Identifier: Apache-2.0
// The states of the connection and the legal steps between them. An illegal step is a bug in this client and throws.
//
//   idle ─start─► seeking ─found─► joining ─opened─► live ─drain─► draining
//                  │  ▲ └─empty─► waiting ─again─► seeking            │
//                  │  └──gone──── joining                             │
//                  └─ refuse ─► refused ─retry─► seeking              │
//   seeking, waiting, joining, live, draining ─lose─► lost ─retry─► seeking
//   every state except stopped ─stop─► stopped

export const STEPS = Object.freeze({
  idle: { start: 'seeking' },
  seeking: { found: 'joining', empty: 'waiting', refuse: 'refused', lose: 'lost' },
  waiting: { again: 'seeking', lose: 'lost' },
  joining: { opened: 'live', gone: 'seeking', refuse: 'refused', lose: 'lost' },
  live: { drain: 'draining', lose: 'lost' },
  draining: { lose: 'lost' },
  lost: { retry: 'seeking' },
  refused: { retry: 'seeking' },
  stopped: {},
});

export class ConnectionState {
  #state = 'idle';
  #listener;

  /** listener(state, step, before) is called after each step. */
  constructor(listener = /** @type {Function} */ (() => {})) {
    this.#listener = listener;
  }

  get state() { return this.#state; }

  can(step) {
    return (step === 'stop' && this.#state !== 'stopped') || Object.hasOwn(STEPS[this.#state], step);
  }

  step(step) {
    if (!this.can(step)) throw new Error(`connection: "${step}" is not a step from "${this.#state}"`);
    const before = this.#state;
    this.#state = step === 'stop' ? 'stopped' : STEPS[before][step];
    this.#listener(this.#state, step, before);
  }
}
