// SPDX-License-Identifier: Apache-2.0
// Import and export of transfer functions. A bad file leaves everything as it was and explains itself beside the button.
import { BYTES_MAX, readTransferFile, stretch, writeOwn, writeParaview } from '../../core/transfer_files.js';
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';

export function install({ transfer, viewer }) {
  new TransferFiles(transfer, { name: () => viewer.view?.volume ?? 'splatd' });
}

class TransferFiles {
  #transfer; #name;

  /** name(): for exported files, without an extension. */
  constructor(transfer, { name }) {
    this.#transfer = transfer;
    this.#name = name;
    const input = byId('transfer-file');
    byId('transfer-import').addEventListener('click', () => input.click());
    input.addEventListener('change', ({ timeStamp }) => {
      const [file] = input.files;
      if (file) this.#take(file, timeStamp);
      input.value = ''; // the same file may be chosen again
    });
    const panel = byId('transfer');
    panel.addEventListener('dragover', (event) => {
      if (event.dataTransfer?.types.includes('Files')) event.preventDefault();
    });
    panel.addEventListener('drop', (event) => {
      const [file] = event.dataTransfer?.files ?? [];
      if (!file) return;
      event.preventDefault();
      if (transfer.isEditable) this.#take(file, event.timeStamp);
    });
    byId('transfer-export').addEventListener('click', () => {
      this.#save('transfer-function.json', writeOwn(this.#name(), transfer.points, transfer.state.gradient));
    });
    byId('transfer-paraview').addEventListener('click', () => this.#save('paraview.json', writeParaview(this.#name(), transfer.points)));
  }

  async #take(file, time) {
    const said = byId('transfer-file-said');
    said.className = 'about';
    said.hidden = true;
    try {
      if (file.size > BYTES_MAX) throw new Error(t('transfer.file.large', { bytes: file.size, most: BYTES_MAX }));
      const read = readTransferFile(await file.text());
      if (!this.#transfer.isEditable) throw new Error(t('transfer.file.locked'));
      if (read.kind === 'map') this.#transfer.useMap(read, time);
      const stretched = read.kind === 'whole' ? stretch(read, this.#transfer.range) : null;
      if (read.kind === 'whole') this.#transfer.replace(stretched ? { ...read, points: stretched } : read, time);
      said.textContent = read.kind === 'map' ? t('transfer.file.map', { map: read.name, file: file.name })
        : t(stretched ? 'transfer.file.stretched' : 'transfer.file.whole', { file: file.name });
    } catch (error) {
      said.className = 'complaint';
      said.textContent = t('transfer.file.wrong', { file: file.name, reason: error.message });
    }
    said.hidden = false;
    said.scrollIntoView?.({ block: 'nearest' });
  }

  #save(suffix, text) {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([text], { type: 'application/json' }));
    link.download = `${this.#name()}-${suffix}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
}
