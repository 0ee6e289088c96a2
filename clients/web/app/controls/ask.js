// SPDX-License-Identifier: Apache-2.0
// A question before something that cannot be undone.

/** Promise of true if the button that says `act` was pressed. */
export function ask(question, act) {
  const dialog = document.getElementById('ask');
  dialog.querySelector('#ask-text').textContent = question;
  dialog.querySelector('#ask-act').textContent = act;
  dialog.returnValue = '';
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener('close', () => resolve(dialog.returnValue === 'yes'), { once: true });
  });
}
