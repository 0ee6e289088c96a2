// SPDX-License-Identifier: Apache-2.0
// The mode in which a drag in the picture changes window and level. A bar above the picture shows that it is on.

const byId = (id) => document.getElementById(id);
const KEY_PX = 12;

export class WindowLevel {
  #transfer;
  #isOn = false;

  constructor(transfer) {
    this.#transfer = transfer;
    byId('transfer-window').addEventListener('click', () => this.set(!this.#isOn));
    byId('window-done').addEventListener('click', () => this.set(false));
    window.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape' || !this.#isOn || event.target.closest?.('dialog')) return;
      this.set(false);
      event.preventDefault();
    });
    transfer.onShow(() => this.#show());
  }

  get isOn() { return this.#isOn; }

  toggle() { this.set(!this.#isOn); }

  set(isOn) {
    const hadFocus = byId('window-bar').contains(document.activeElement);
    this.#isOn = isOn && this.#transfer.isEditable;
    if (hadFocus && !this.#isOn) byId('screen').focus();
    this.#show();
  }

  #show() {
    if (this.#isOn && !this.#transfer.isEditable) this.#isOn = false; // control went to another participant
    byId('transfer-window').setAttribute('aria-pressed', String(this.#isOn));
    byId('transfer-window').disabled = !this.#transfer.isEditable;
    byId('window-bar').hidden = !this.#isOn;
    byId('screen').toggleAttribute('data-window', this.#isOn);
    if (this.#isOn) byId('window-values').textContent = this.#transfer.windowText;
  }

  begin() { this.#transfer.beginWindow(); }
  drag(dx, dy, time) { this.#transfer.dragWindow(dx, dy, time); }
  end() { this.#transfer.endWindow(); }

  /** One press of an arrow key; dx, dy in steps, y upwards. */
  step(dx, dy, time) {
    this.begin();
    this.drag(dx * KEY_PX, -dy * KEY_PX, time);
    this.end();
  }
}
