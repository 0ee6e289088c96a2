// SPDX-License-Identifier: Apache-2.0
// A JupyterLab of its own for one test file, and notebooks in it. Every wait is for a condition and has a deadline.
import { spawn } from 'node:child_process';
import { existsSync, mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { setTimeout } from 'node:timers/promises';
import { fileURLToPath } from 'node:url';

export const DEADLINE_MS = 90000;
const POLL_MS = 100;
const START_POLLS = 30;
const ROOT = fileURLToPath(new URL('../..', import.meta.url));
const VENV = process.env.SPLATD_NOTEBOOK_VENV ?? path.join(ROOT, 'build/notebook');
export const PYTHON = path.join(VENV, 'bin/python');
export const hasLab = existsSync(path.join(VENV, 'bin/jupyter-lab'));
const TOKEN = 'of-the-tests';

async function freePort() {
  const server = createServer();
  await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
  const { port } = server.address();
  await new Promise((resolve) => { server.close(resolve); });
  return port;
}

/** Waits until `look` resolves to something true, and resolves to it. */
export async function until(what, look) {
  for (const end = Date.now() + DEADLINE_MS; Date.now() < end; await setTimeout(POLL_MS)) {
    const found = await look().catch((error) => {
      if (/closed/.test(error.message)) throw error;
      return null;
    });
    if (found) return found;
  }
  throw new Error(`not reached: ${what}`);
}

export class Lab {
  #child; #folder; #base;
  log = '';

  /** options: more arguments of jupyter-lab; base: the path below which it serves. */
  static async start({ base = '/', options = [] } = {}) {
    const lab = new Lab();
    lab.#folder = mkdtempSync(path.join(tmpdir(), 'splatd-lab-'));
    const port = await freePort();
    lab.#base = `http://127.0.0.1:${port}${base}`;
    const folder = (name) => {
      const made = path.join(lab.#folder, name);
      mkdirSync(made);
      return made;
    };
    const env = {
      ...process.env, HOME: lab.#folder, JUPYTER_CONFIG_DIR: folder('config'), JUPYTER_DATA_DIR: folder('data'), JUPYTER_RUNTIME_DIR: folder('runtime'),
      IPYTHONDIR: folder('ipython'), SPLATD_BIN: process.env.SPLATD_BIN ?? path.join(process.env.SPLATD_BIN_DIR, 'splatd'),
      PATH: `${path.join(VENV, 'bin')}:${process.env.PATH}`,
    };
    const notebooks = folder('notebooks');
    const settings = path.join(lab.#folder, 'config/lab/user-settings/@jupyter-widgets/jupyterlab-manager');
    mkdirSync(settings, { recursive: true });
    writeFileSync(path.join(settings, 'plugin.jupyterlab-settings'), '{"saveState": true}'); // "Save Widget State Automatically"
    lab.#child = spawn(path.join(VENV, 'bin/jupyter-lab'), [
      '--no-browser', '--allow-root', '--ip=127.0.0.1', `--port=${port}`, `--ServerApp.base_url=${base}`, `--IdentityProvider.token=${TOKEN}`,
      `--ServerApp.root_dir=${notebooks}`, '--LabApp.extension_manager=readonly', '--LabApp.news_url=', ...options,
    ], { env, stdio: ['ignore', 'pipe', 'pipe'] });
    for (const stream of [lab.#child.stdout, lab.#child.stderr]) stream.on('data', (text) => { lab.log += text; });
    await until(`JupyterLab: ${lab.log}`, async () => (await fetch(`${lab.#base}api/status?token=${TOKEN}`)).ok);
    return lab;
  }

  /** Writes a notebook with code cells. */
  write(name, cells) {
    const notebook = {
      nbformat: 4, nbformat_minor: 5, metadata: { kernelspec: { name: 'python3', display_name: 'Python 3', language: 'python' } },
      cells: cells.map((source, i) => ({ cell_type: 'code', id: `cell-${i}`, metadata: {}, execution_count: null, outputs: [], source })),
    };
    writeFileSync(path.join(this.#folder, 'notebooks', name), JSON.stringify(notebook));
  }

  /** Opens a notebook in a page and waits until its kernel is idle. */
  async open(page, name) {
    await page.goto(`${this.#base}lab/tree/${name}?reset&token=${TOKEN}`);
    await page.locator('.jp-Notebook .jp-CodeCell').first().waitFor({ timeout: DEADLINE_MS });
    await page.locator('.jp-Notebook-ExecutionIndicator[data-status="idle"]').waitFor({ timeout: DEADLINE_MS });
  }

  /** A request to the server, such as for its kernels. */
  async ask(method, address, body = undefined) {
    const answer = await fetch(`${this.#base}${address}`, { method, headers: { Authorization: `token ${TOKEN}` }, body: body && JSON.stringify(body) });
    const text = await answer.text();
    return text ? JSON.parse(text) : null;
  }

  async stop() {
    this.#child.kill('SIGTERM');
    const end = new Promise((resolve) => { this.#child.on('exit', resolve); });
    if (this.#child.exitCode === null) await end;
    rmSync(this.#folder, { recursive: true, force: true });
  }
}

/** Runs a cell, and waits until its execution is done. Throws with its error. */
export async function run(page, index) {
  const cell = page.locator('.jp-Notebook .jp-CodeCell').nth(index);
  const prompt = () => cell.locator('.jp-InputPrompt').textContent();
  const before = await prompt();
  // JupyterLab forgets a cell that is run before it has found out that the kernel is ready: then the prompt stays empty.
  for (let end = Date.now() + DEADLINE_MS; await prompt() === before;) {
    await cell.locator('.cm-content').click();
    await page.keyboard.press('Control+Enter');
    for (let i = 0; i < START_POLLS && await prompt() === before; i += 1) await setTimeout(POLL_MS);
    if (Date.now() > end) throw new Error(`cell ${index} does not start`);
  }
  await until(`cell ${index} has run`, async () => /\[\d+\]/.test(await prompt()));
  const error = cell.locator('[data-mime-type="application/vnd.jupyter.stderr"], [data-mime-type="application/vnd.jupyter.error"]');
  if (await error.count()) throw new Error(await error.first().textContent());
  return cell;
}

/** What a cell has printed. */
export const printed = (cell) => cell.locator('.jp-OutputArea').innerText();

/** Replaces the code of a cell. */
export async function type(page, index, code) {
  const editor = page.locator('.jp-Notebook .jp-CodeCell').nth(index).locator('.cm-content');
  await editor.click();
  await page.keyboard.press('Control+A');
  await page.keyboard.insertText(code);
}
