// SPDX-License-Identifier: Apache-2.0
// The participants of the session and the holder of control, from the messages session.participants and session.control.
// `you` is the id of this client.
import { t } from './text.js';

export class Participants {
  #people = [];
  #you = null;
  #holder = null;
  #requests = [];

  /** Clears everything, because the stream is lost. */
  reset() {
    this.#people = [];
    this.#you = this.#holder = null;
    this.#requests = [];
  }

  takeParticipants({ participants = [], you = null }) {
    this.#people = participants;
    this.#you = you;
  }

  takeControl({ holder = null, requests = [] }) {
    this.#holder = holder;
    this.#requests = requests;
  }

  get you() { return this.#you; }
  get me() { return this.#people.find((p) => p.id === this.#you) ?? null; }
  get count() { return this.#people.length; }
  get isHolder() { return this.#holder !== null && this.#holder === this.#you; }
  get isAsking() { return this.#requests.some((r) => r.id === this.#you); }
  /** True if the token of this client may control the view, even if another participant does now. */
  get hasControlRole() { return this.me?.role !== 'view'; }
  /** True if the daemon accepts a change of the view now: from the holder or, without a holder, from any control role. */
  get mayChange() { return this.isHolder || (this.#holder === null && this.hasControlRole); }
  /** True if a request for control can succeed. A view role can get control from a holder only. */
  get mayAsk() { return !this.isHolder && !this.isAsking && (this.#holder !== null || this.hasControlRole); }

  /** [{id, name, color, isYou, isHolder, asks}], this client first. asks: null, or {seconds} until control passes on (null = never). */
  get people() {
    const rank = (p) => (p.id === this.#you ? -1 : p.id);
    return [...this.#people].sort((a, b) => rank(a) - rank(b)).map((p) => {
      const request = this.#requests.find((r) => r.id === p.id);
      return {
        id: p.id, name: p.name || t('people.guest', { id: p.id }), color: p.color ?? '#cccccc', isYou: p.id === this.#you,
        isHolder: p.id === this.#holder, asks: request ? { seconds: request.seconds ?? null } : null,
      };
    });
  }

  /** The holder of control, or null. */
  get holder() { return this.people.find((p) => p.isHolder) ?? null; }

  /** Tells a user who may not change the view why. */
  get whyNot() {
    const { holder } = this;
    if (holder) return t('people.whynot.holder', { name: holder.name });
    return t(this.hasControlRole ? 'people.whynot.now' : 'people.whynot.watch');
  }
}
