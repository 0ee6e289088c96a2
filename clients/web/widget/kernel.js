// SPDX-License-Identifier: Apache-2.0
// One view of a notebook and its kernel. They exchange custom messages of the widget's model; clients/python/src/splatd/_channel.py is the
// other end. Every message names the view, because all views of a model hear all messages:
//
//   to the kernel    hello, bye | request {id, method, path, body} | open {id}, send {id, text}, close {id} | view {view} | used {transport}
//   from the kernel  welcome {…} | answer {id, status, headers} + body | opened {id}, text {id, text}, frame {id} + bytes, closed {id, code, reason}
//
// A frame is one top-level buffer, as the daemon sent it. Acknowledgements are texts of the stream, so the daemon sends no more than arrives.

let ids = 0;
const nameOf = () => Array.from(crypto.getRandomValues(new Uint32Array(2)), (part) => part.toString(36)).join('');

/** The bytes of a DataView as an ArrayBuffer of their own: the buffers of one message may share their memory. */
const bytesOf = ({ buffer, byteOffset, byteLength }) => (
  byteLength === buffer.byteLength ? buffer : buffer.slice(byteOffset, byteOffset + byteLength));

export class Kernel {
  #model;
  #view = nameOf();
  #answers = new Map(); // by id: what takes an answer and its body
  #streams = new Map(); // by id: the Hearer of a stream
  #welcomes = new Set();
  #hear = (content, buffers) => this.#take(content, buffers ?? []);

  constructor(model) {
    this.#model = model;
    model.on('msg:custom', this.#hear);
  }

  /** Sends a message. Without a kernel, nothing happens. */
  tell(type, content = {}) {
    try {
      this.#model.send({ ...content, type, of: this.#view });
    } catch { /* the notebook has no kernel, or the widget is closed */ }
  }

  /** Resolves to how the picture is reached, as soon as the kernel answers: {session, token, url, port, transport}. It may never do so. */
  hello() {
    return new Promise((resolve) => {
      this.#welcomes.add(resolve);
      this.tell('hello');
    });
  }

  /** The last message; afterwards nothing is heard. */
  bye() {
    this.tell('bye');
    this.#model.off('msg:custom', this.#hear);
    this.#welcomes.clear();
  }

  /** @type {import('../core/transport.js').Transport} */
  transport = {
    request: (method, path, { body, signal }) => new Promise((resolve, reject) => {
      const id = ++ids;
      const end = () => {
        this.#answers.delete(id);
        reject(signal.reason);
      };
      signal?.addEventListener('abort', end, { once: true });
      this.#answers.set(id, ({ status, headers }, [data]) => {
        signal?.removeEventListener('abort', end);
        resolve(new Response(data?.byteLength ? bytesOf(data) : null, { status, headers }));
      });
      this.tell('request', { id, method, path, body: body ?? null });
    }),
    open: (path, token, hearer) => {
      const id = ++ids;
      this.#streams.set(id, hearer);
      this.tell('open', { id });
      return {
        send: (text) => this.#streams.has(id) && this.tell('send', { id, text }),
        close: () => this.#streams.delete(id) && this.tell('close', { id }),
      };
    },
  };

  #take({ type, of, id, ...content }, buffers) {
    if (of !== this.#view) return;
    const hearer = this.#streams.get(id);
    if (type === 'welcome') {
      for (const resolve of this.#welcomes) resolve(content);
      this.#welcomes.clear();
    } else if (type === 'answer') {
      this.#answers.get(id)?.(content, buffers);
      this.#answers.delete(id);
    } else if (type === 'opened') {
      hearer?.opened();
    } else if (type === 'text') {
      hearer?.heard(content.text);
    } else if (type === 'frame') {
      hearer?.heard(bytesOf(buffers[0]));
    } else if (type === 'closed') {
      this.#streams.delete(id);
      hearer?.closed(content.code, content.reason);
    }
  }
}
