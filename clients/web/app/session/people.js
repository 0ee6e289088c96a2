// SPDX-License-Identifier: Apache-2.0
// The participants of the session, control, links and forks.
import { t } from '../../core/text.js';
import { rememberSession } from '../shell/address.js';
import { byId, make } from '../controls/dom.js';

/** Links for others; null where this client has no token for the link. */
function links({ connection, participants, viewer, base }, fork) {
  const { session, api, isLive } = connection;
  const none = { watch: null, control: null, view: null, fork: null };
  if (!isLive || !session) return none;
  const join = (token) => token && (async () => `${base}#${new URLSearchParams({ session: session.id, token })}`);
  const keep = async () => `${base}#${new URLSearchParams({ view: (await api.saveView(viewer.view)).id })}`;
  return {
    watch: join(session.tokens?.view), control: join(session.tokens?.control),
    view: session.isJoined ? null : keep,
    fork: session.isJoined && !participants.hasControlRole ? null : fork,
  };
}

/** A link to the session for which this client has a join token alone. */
export const joinLink = ({ base, connection: { session } }) => `${base}#${new URLSearchParams({ session: session.id, token: session.token })}`;

/** What to say after a link to a saved view was copied, or not: who can open it, and which link others need. */
export function saidOfLink({ api, connection }, isCopied) {
  const copied = t(isCopied ? 'people.copied' : 'people.copy');
  if (connection.session?.isJoined) return t('people.link.joins', { copied });
  return api.token ? t('people.link.token', { copied }) : copied;
}

/** Continues in a new session of this client that starts with this view. */
async function fork(app) {
  const { session, api } = app.connection;
  const made = await api.sessionFrom(session.id, session.isJoined ? session.token : api.token);
  const own = session.isJoined ? `#${new URLSearchParams({ session: made.id, token: made.tokens.control })}` : '';
  if (!session.isJoined) rememberSession(app, made);
  history.replaceState(null, '', location.pathname + own);
  location.reload();
}

const DENIED_MS = 6000;

export function install(app) {
  const { connection, participants, viewer, storage, status, prompts, report } = app;
  const people = new People(participants, {
    call: (method, params) => connection.call(method, params), fail: report, links: () => links(app, () => fork(app)), prompts,
    said: (kind, isCopied) => (kind === 'view' ? saidOfLink(app, isCopied) : t(isCopied ? 'people.copied' : 'people.copy')),
    rename: (name) => {
      storage.remember('name', name);
      app.configure({ name });
    },
  });
  let own = null; // {session, name}: the name that this page has there
  /** The name that the daemon gave first stays over a reload and a restart of the daemon. A copy of the tab finds it taken, and keeps its own. */
  const keepName = () => {
    const { me, people: all } = participants;
    const session = connection.session?.id;
    if (!me?.name || !session || own?.session === session || storage.recall('name')) return;
    const key = `guest:${session}`;
    const known = storage.recall(key);
    const isFree = known && !all.some(({ isYou, name }) => !isYou && name === known);
    own = { session, name: isFree ? known : me.name };
    storage.remember(key, own.name);
    if (own.name !== me.name) app.configure({ name: own.name });
  };
  app.guestName = () => (own?.session === connection.session?.id ? own?.name : null);
  app.showParticipants = () => {
    keepName();
    viewer.allow(participants.mayChange);
    status.setParticipants(participants);
    people.show();
  };
  viewer.on('denied', () => people.sayDenied());
}

class People {
  #participants; #call; #fail; #links; #said; #prompts;
  #key = '';
  #was = { isHolder: false, isAsking: false, holder: null };
  #isOwnAct = false; // this user gave control away or stopped asking

  /**
   * call(method, params) → promise; fail(Error) shows it; links(): {watch, control, view, fork}. Each is a function that
   * resolves to an address (fork resolves to nothing and leaves the page), or null if this client cannot create it.
   * said(kind, isCopied) → what to say of a link; rename(name) sets the name of this participant; prompts: prompts.js.
   */
  constructor(participants, { call, fail, links, said, rename, prompts }) {
    this.#participants = participants;
    this.#call = (method, params) => call(method, params).catch(fail);
    this.#fail = fail;
    this.#links = links;
    this.#said = said;
    this.#prompts = prompts;
    byId('person-name').addEventListener('change', (event) => {
      const name = event.target.value.trim();
      if (name) rename(name);
    });
    byId('control-ask').addEventListener('click', () => this.#call('session.request_control'));
    byId('control-release').addEventListener('click', () => {
      this.#isOwnAct = true;
      this.#call('session.release_control');
    });
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
      byId('link-note').textContent = this.#said(kind, isCopied);
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
    byId('control-release').textContent = t(this.#participants.isHolder ? 'people.release' : 'people.release.asking');
    for (const kind of ['watch', 'control', 'view']) byId(`link-${kind}`).hidden = !links[kind];
    byId('fork').hidden = !links.fork;
    const key = JSON.stringify([people, this.#participants.isHolder]);
    if (key === this.#key) return;
    this.#key = key;
    this.#sayControl();
    const name = byId('person-name');
    if (me && document.activeElement !== name) name.value = me.name ?? '';
    byId('people-dots').replaceChildren(...people.map((p) => this.#dot(p)));
    byId('people-dots').hidden = count < 2;
    byId('people').replaceChildren(...people.map((p) => this.#entry(p)));
    this.#showRequests(this.#participants.isHolder ? people.filter((p) => p.asks && !p.isYou) : []);
    if (this.#participants.mayChange || this.#participants.isAsking) this.#prompts.hide('denied');
  }

  #grant(to) {
    this.#isOwnAct = true;
    this.#call('session.grant_control', { to });
  }

  /** Says what became of control, because the section may be folded: it passed on, or a request was answered. */
  #sayControl() {
    const { isHolder, isAsking, holder } = this.#participants;
    const was = this.#was;
    this.#was = { isHolder, isAsking, holder: holder?.id ?? null };
    const isAnswered = was.isAsking && !isAsking;
    if (isAsking) this.#prompts.hide('control');
    if (isHolder) {
      if (isAnswered) this.#prompts.show('control', { text: t('people.gained'), ms: DENIED_MS });
    } else if (holder && !this.#isOwnAct && (isAnswered || was.isHolder)) {
      this.#prompts.show('control', { text: t(was.holder === holder.id ? 'people.refused' : 'people.passed', { name: holder.name }), ms: DENIED_MS });
    }
    if (isAnswered || was.isHolder !== isHolder) this.#isOwnAct = false;
  }

  /** Requests for control are shown over the picture, wherever the panel is. */
  #showRequests(asking) {
    for (const { id, name, asks: { seconds } } of asking) {
      this.#prompts.show(`asked:${id}`, {
        text: seconds === null ? t('people.asked', { name }) : t('people.asked.until', { name, seconds: Math.ceil(seconds) }), isUrgent: true,
        actions: [
          { label: t('people.grant'), press: () => this.#grant(id) },
          { label: t('people.refuse'), press: () => this.#call('session.refuse_control', { to: id }) },
        ],
      });
    }
    this.#prompts.hideOthers('asked:', asking.map(({ id }) => `asked:${id}`));
  }

  /** Says why the view does not follow the hand, and offers to ask for control. A gesture that goes on does not repeat it. */
  sayDenied() {
    const { holder, isAsking, mayAsk, hasControlRole } = this.#participants;
    const name = holder?.name ?? '';
    const text = isAsking ? t('view.denied.asking', { name }) : holder ? t('view.denied.holder', { name })
      : t(hasControlRole ? 'view.denied.free' : 'view.denied.watch');
    const ask = { label: t('people.ask'), press: () => this.#call('session.request_control') };
    this.#prompts.show('denied', { text, actions: mayAsk ? [ask] : [], ms: DENIED_MS });
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
    about.textContent = [person.isYou && t('people.you'), person.isHolder && t('people.controls'), person.asks && t('people.asks')]
      .filter(Boolean).join(', ');
    item.append(this.#dot(person), name, about);
    if (this.#participants.isHolder && person.asks) {
      item.append(
        make('button', { text: t('people.grant'), press: () => this.#grant(person.id) }),
        make('button', { text: t('people.refuse'), press: () => this.#call('session.refuse_control', { to: person.id }) }),
      );
    }
    return item;
  }
}
