// SPDX-License-Identifier: Apache-2.0
// Who is in the session and who holds control of its view, as the daemon tells it (session.participants and
// session.control). `you` is the id of this client.

export class Company {
  #people = [];
  #you = null;
  #holder = null;
  #requests = [];

  /** Nothing is known any more: the stream is gone. */
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
  /** Its token may control, whether it does now or not. */
  get hasControlRole() { return this.me?.role !== 'view'; }
  /** Would a change of the view be taken now? Who holds control may, and if nobody does whoever has the role. */
  get mayChange() { return this.isHolder || (this.#holder === null && this.hasControlRole); }
  /** Is there any sense in asking? A view role gets control from a holder alone. */
  get mayAsk() { return !this.isHolder && !this.isAsking && (this.#holder !== null || this.hasControlRole); }

  /** [{id, name, color, isYou, isHolder, asks}], this client first; asks: null, or {seconds} until control passes on (null = never). */
  get people() {
    const rank = (p) => (p.id === this.#you ? -1 : p.id);
    return [...this.#people].sort((a, b) => rank(a) - rank(b)).map((p) => {
      const request = this.#requests.find((r) => r.id === p.id);
      return {
        id: p.id, name: p.name || `Guest ${p.id}`, color: p.color ?? '#cccccc', isYou: p.id === this.#you,
        isHolder: p.id === this.#holder, asks: request ? { seconds: request.seconds ?? null } : null,
      };
    });
  }

  /** Who holds control, or null. */
  get holder() { return this.people.find((p) => p.isHolder) ?? null; }
}
