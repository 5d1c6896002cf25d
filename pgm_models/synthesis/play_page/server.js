// What the server is asked. Every address is relative to the page's own, which holds the token.

export class ServerError extends Error {}

async function ask(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ServerError("The server does not answer. Is pgm play still running?");
  }
  if (answer.ok) return answer;
  let words = `${answer.status} ${answer.statusText}`;
  try {
    words = (await answer.json()).error ?? words;
  } catch { /* no words came with it */ }
  throw new ServerError(words);
}

const sent = (value, signal) => ({
  method: "POST",
  headers: { "Content-Type": "application/json" },
  body: JSON.stringify(value),
  signal,
});

export const stage = async () => (await ask("api/stage")).json();
export const order = async (prompt) => (await (await ask("api/rallies", sent(prompt))).json()).rally;
export const progress = async (rally) => (await ask(`api/rallies/${rally}`)).json();
export const cancel = async (rally) => (await ask(`api/rallies/${rally}`, { method: "DELETE" })).json();
export const states = async (rally) => (await ask(`api/rallies/${rally}/states`)).json();
export const values = async (rally, frame) => (await ask(`api/rallies/${rally}/values/${frame}`)).json();
export const picture = async (rally, frame, camera, signal) =>
  (await ask(`api/rallies/${rally}/pictures/${frame}`, sent(camera, signal))).blob();
