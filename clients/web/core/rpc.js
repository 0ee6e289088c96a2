// SPDX-License-Identifier: Apache-2.0
// JSON-RPC 2.0 over the text messages of a stream: calls with answers, and notifications in both directions.

export class RpcError extends Error {
  name = 'RpcError';
  constructor({ code, message, data } = {}) {
    super(message ?? 'an error without a message');
    this.code = code ?? 0;
    this.pointer = data?.pointer ?? '';
  }
}

export class Rpc {
  #write; #notified;
  #id = 0;
  #calls = new Map();

  /** write(text) sends a message; notified(method, params) receives the server's notifications. */
  constructor({ write, notified }) {
    this.#write = write;
    this.#notified = notified;
  }

  /** Calls a method; resolves to the result. Rejects with RpcError, or with the reason given to close(). */
  call(method, params = {}) {
    const id = ++this.#id;
    return new Promise((resolve, reject) => {
      this.#calls.set(id, { resolve, reject });
      this.#write(JSON.stringify({ jsonrpc: '2.0', id, method, params }));
    });
  }

  notify(method, params = {}) {
    this.#write(JSON.stringify({ jsonrpc: '2.0', method, params }));
  }

  /** Takes one text message. Throws if it is not JSON-RPC 2.0. */
  take(text) {
    const message = JSON.parse(text);
    if (message?.jsonrpc !== '2.0') throw new Error('a text message that is not JSON-RPC 2.0');
    if (typeof message.method === 'string') {
      this.#notified(message.method, message.params ?? {});
      return;
    }
    const call = this.#calls.get(message.id);
    if (!call) {
      if (message.error) throw new RpcError(message.error);
      throw new Error(`an answer to a call that was not made (id ${message.id})`);
    }
    this.#calls.delete(message.id);
    if (message.error) call.reject(new RpcError(message.error));
    else call.resolve(message.result);
  }

  /** Rejects all pending calls with `reason`. */
  close(reason) {
    const calls = [...this.#calls.values()];
    this.#calls.clear();
    for (const call of calls) call.reject(reason);
  }
}
