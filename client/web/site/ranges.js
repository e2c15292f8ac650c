// Fetches byte ranges of a published scene's objects, and classifies failures (client/source/fetch.h, FetchOutcome).

export const kBytes = 0;
const kNetwork = 1, kNotFound = 2, kForbidden = 3, kRangeIgnored = 4, kCompressed = 5, kChanged = 6, kTooShort = 7,
      kServer = 8;
const kOutcomes = new Map(
    [[401, kForbidden], [403, kForbidden], [404, kNotFound], [410, kNotFound], [412, kChanged], [416, kTooShort]]);

/// Returns "bytes 5-9/100" as [5, 9]; null when the header is absent or hidden from this page.
function contentRange(answer) {
  const found = /^bytes (\d+)-(\d+)\//.exec(answer.headers.get("Content-Range") ?? "");
  return found && [Number(found[1]), Number(found[2])];
}

/// Returns {fetch(job, name, offset, length), cancel(job)}. `base`: the scene's folder. `done(job, outcome, status,
/// bytes, detail)` is called once for each job that is not cancelled.
export function makeRanges(base, done) {
  const running = new Map();
  const tags = new Map();  // object -> its ETag, so that a change is noticed

  async function get(job, name, offset, length, signal) {
    const answer =
        await fetch(new URL(name, base), {headers: {Range: `bytes=${offset}-${offset + length - 1}`}, signal});
    const fail = (outcome, detail = "") => {
      running.get(job)?.abort();  // the rest of the body is not read
      return [outcome, answer.status, null, detail];
    };
    if (answer.status === 200) return fail(kRangeIgnored);
    if (answer.status !== 206) return fail(kOutcomes.get(answer.status) ?? kServer, answer.statusText);
    if (answer.headers.get("Content-Encoding")) return fail(kCompressed, answer.headers.get("Content-Encoding"));
    const range = contentRange(answer);
    if (range && range[0] !== offset) return fail(kRangeIgnored);
    if (range && range[1] !== offset + length - 1) return fail(kTooShort);
    const tag = answer.headers.get("ETag");
    if (tag && !tag.startsWith("W/")) {
      if (tags.has(name) && tags.get(name) !== tag) return fail(kChanged);
      tags.set(name, tag);
    }
    const bytes = new Uint8Array(await answer.arrayBuffer());
    if (bytes.length !== length)
      return [bytes.length < length ? kTooShort : kCompressed, answer.status, null, `${bytes.length} bytes`];
    return [kBytes, answer.status, bytes, ""];
  }

  return {
    async fetch(job, name, offset, length) {
      const stop = new AbortController();
      running.set(job, stop);
      let result;
      try {
        result = await get(job, name, offset, length, stop.signal);
      } catch (error) {
        result = [kNetwork, 0, null, error.message];
      }
      if (running.get(job) !== stop) return;  // cancelled
      running.delete(job);
      done(job, ...result);
    },
    cancel(job) {
      running.get(job)?.abort();
      running.delete(job);
    },
  };
}
