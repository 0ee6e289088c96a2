// SPDX-License-Identifier: Apache-2.0
// The banner shows what prevents the picture; the notice shows all other messages. Each message is one sentence.
import { t } from '../../core/text.js';
import { icon, make } from '../controls/dom.js';

const NOTICE_MS = 9000;
const TONES = {
  info: () => icon('info'), success: () => icon('circle-check'), warning: () => icon('triangle-alert'), error: () => icon('circle-x'),
};

export class Banner {
  #root; #title; #text; #progress; #retry; #form; #open;
  #countdown = null;
  #isAsking = false;

  /** retry() and useToken(token) are what the user can do about it. */
  constructor(root, { retry, useToken }) {
    this.#root = root;
    this.#title = root.querySelector('#banner-title');
    this.#text = root.querySelector('#banner-text');
    this.#progress = root.querySelector('#banner-progress');
    this.#retry = root.querySelector('#banner-retry');
    this.#form = root.querySelector('#token-form');
    this.#open = root.querySelector('#banner-open');
    this.#retry.addEventListener('click', retry);
    this.#form.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape' || !this.#isAsking) return;
      this.#isAsking = false;
      this.hide();
    });
    this.#form.addEventListener('submit', (event) => {
      event.preventDefault();
      const input = this.#form.elements.token;
      // The whole printed address serves as well as its token.
      const token = /[?#&]token=([^&#\s]+)/.exec(input.value)?.[1] ?? input.value.trim();
      if (token) useToken(token);
    });
  }

  /** Hides it, but not while it asks for a token beside the picture. */
  hide() {
    if (this.#isAsking) return;
    this.#stop();
    this.#root.hidden = true;
  }

  /** kind: busy | wait | error, shown in the middle; lost: shown at the top, above the last frame */
  show({ kind, title, text = '', progress = null, canRetry = false, asksToken = false, canOpen = false }) {
    this.#stop();
    this.#isAsking = false;
    this.#root.hidden = false;
    this.#root.dataset.kind = kind;
    this.#set(this.#title, title);
    this.#set(this.#text, text);
    this.#progress.hidden = progress === null;
    if (progress !== null) this.#progress.value = progress;
    this.#retry.hidden = !canRetry;
    this.#form.hidden = !asksToken;
    this.#open.hidden = !canOpen;
  }

  /** Asks for a token although the picture is there; Escape ends it. */
  askToken() {
    this.show({ kind: 'lost', title: t('banner.token.new'), text: t('banner.token.text'), asksToken: true });
    this.#isAsking = true;
    this.#form.elements.token.focus();
  }

  /** The connection is lost and will be tried again in `retryMs`. why: lost, busy (the daemon is over a limit) or offline. */
  showLost(reason, retryMs, why = 'lost') {
    const until = performance.now() + retryMs;
    const title = () => {
      const seconds = Math.max(0, Math.ceil((until - performance.now()) / 1000));
      return seconds > 0 ? t(`banner.${why}.in`, { seconds }) : t(`banner.${why}.now`);
    };
    this.show({
      kind: 'lost', title: title(), canRetry: true,
      text: reason ? `${reason[0].toUpperCase()}${reason.slice(1)}.`.replace(/\.\.$/, '.') : t('banner.lost.gone'),
    });
    this.#countdown = setInterval(() => this.#set(this.#title, title()), 250);
  }

  #set(element, text) {
    element.hidden = !text;
    if (element.textContent !== text) element.textContent = text;
  }

  #stop() {
    clearInterval(this.#countdown);
    this.#countdown = null;
  }
}

export class Notice {
  #root; #text; #icon;
  #timer = null;
  #kind = '';

  constructor(root) {
    this.#root = root;
    this.#text = root.querySelector('#notice-text');
    this.#icon = make('span', { class: 'tone', 'aria-hidden': 'true' });
    root.prepend(this.#icon);
    root.querySelector('#notice-close').addEventListener('click', () => this.hide());
  }

  /** tone: info, success, warning or error; kind: for hide(). */
  show(text, tone = 'info', kind = 'message') {
    clearTimeout(this.#timer);
    this.#kind = kind;
    if (this.#root.dataset.tone !== tone) {
      this.#root.dataset.tone = tone;
      this.#icon.replaceChildren(TONES[tone]());
    }
    this.#text.textContent = text;
    this.#root.hidden = false;
    this.#timer = setTimeout(() => this.hide(), NOTICE_MS);
  }

  /** Hides it; with a kind, only if it is of that kind. */
  hide(kind = this.#kind) {
    if (kind !== this.#kind) return;
    clearTimeout(this.#timer);
    this.#root.hidden = true;
  }
}
