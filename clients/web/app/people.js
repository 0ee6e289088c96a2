// SPDX-License-Identifier: Apache-2.0
// The participants of the session, control, links and forks.

const byId = (id) => document.getElementById(id);

function button(text, press) {
  const made = document.createElement('button');
  made.type = 'button';
  made.textContent = text;
  made.addEventListener('click', press);
  return made;
}

export class People {
  #participants; #call; #fail; #links;
  #key = '';
  #asked = 0;

  /**
   * call(method, params) → promise; fail(Error) shows it; links(): {watch, control, view, fork}. Each is a function that
   * resolves to an address (fork resolves to nothing and leaves the page), or null if this client cannot create it.
   * rename(name) sets the name of this participant.
   */
  constructor(participants, { call, fail, links, rename }) {
    this.#participants = participants;
    this.#call = (method, params) => call(method, params).catch(fail);
    this.#fail = fail;
    this.#links = links;
    byId('person-name').addEventListener('change', (event) => {
      const name = event.target.value.trim();
      if (name) rename(name);
    });
    byId('control-ask').addEventListener('click', () => this.#call('session.request_control'));
    byId('control-release').addEventListener('click', () => this.#call('session.release_control'));
    for (const kind of ['watch', 'control', 'view']) {
      byId(`link-${kind}`).addEventListener('click', () => this.#share(kind));
    }
    byId('fork').addEventListener('click', () => this.#links().fork?.().catch(fail));
    byId('link-text').addEventListener('focus', (event) => event.target.select());
  }

  async #share(kind) {
    try {
      const address = await this.#links()[kind]();
      const field = byId('link-text');
      byId('link-row').hidden = false;
      field.value = address;
      field.focus();
      // Without a secure context there is no clipboard; the user copies from the field.
      const isCopied = await navigator.clipboard?.writeText(address).then(() => true, () => false);
      byId('link-note').textContent = isCopied ? 'copied' : 'copy it from here';
    } catch (error) {
      this.#fail(error);
    }
  }

  /** Redraws changed parts. */
  show() {
    const { people, me, count } = this.#participants;
    const links = this.#links();
    byId('control-ask').hidden = count < 2 || !this.#participants.mayAsk;
    byId('control-release').hidden = count < 2 || !(this.#participants.isHolder || this.#participants.isAsking);
    byId('control-release').textContent = this.#participants.isHolder ? 'Release control' : 'Stop asking';
    for (const kind of ['watch', 'control', 'view']) byId(`link-${kind}`).hidden = !links[kind];
    byId('fork').hidden = !links.fork;
    const key = JSON.stringify([people, this.#participants.isHolder]);
    if (key === this.#key) return;
    this.#key = key;
    const name = byId('person-name');
    if (me && document.activeElement !== name) name.value = me.name ?? '';
    byId('people-dots').replaceChildren(...people.map((p) => this.#dot(p)));
    byId('people-dots').hidden = count < 2;
    byId('people').replaceChildren(...people.map((p) => this.#entry(p)));
    const asking = people.filter((p) => p.asks && !p.isYou).length;
    if (this.#participants.isHolder && asking > this.#asked) byId('people-fold').open = true;
    this.#asked = asking;
  }

  #dot({ color, name }) {
    const dot = document.createElement('span');
    dot.className = 'dot';
    dot.style.backgroundColor = color;
    dot.title = name;
    return dot;
  }

  #entry(person) {
    const item = document.createElement('li');
    item.dataset.id = person.id;
    const name = document.createElement('span');
    name.className = 'name';
    name.textContent = person.name;
    const about = document.createElement('span');
    about.className = 'about';
    about.textContent = [person.isYou ? 'you' : '', person.isHolder ? 'controls' : '', person.asks ? 'asks' : '']
      .filter(Boolean).join(', ');
    item.append(this.#dot(person), name, about);
    if (this.#participants.isHolder && person.asks) {
      item.append(
        button('Grant', () => this.#call('session.grant_control', { to: person.id })),
        button('Refuse', () => this.#call('session.refuse_control', { to: person.id })),
      );
    }
    return item;
  }
}
