// Decodes images off the page's thread, on a few workers, the least busy first.

const kMaxWorkers = 4;

/// Returns decode(low, high, bytes). `files`: URLs of the worker and its WebAssembly. `done(low, high, image, error)`
/// gets the image {width, height, rgba}, or null for an empty flag.
export function makeDecoder(files, done) {
  const workers = [];
  const jobs = new Map();
  let next = 0;

  function finish(job, image, error) {
    const {low, high, worker} = jobs.get(job);
    jobs.delete(job);
    --worker.busy;
    done(low, high, image, error);
  }

  function start() {
    const worker = new Worker(files.worker, {type: "module"});
    worker.busy = 0;
    worker.onmessage = ({data}) => finish(data.job, data.image ?? null, data.error ?? "");
    // When a worker cannot even start, its images count as broken, and the page says why.
    worker.onerror = (event) => {
      for (const [job, {worker: owner}] of [...jobs])
        if (owner === worker) finish(job, null, `decoding failed: ${event.message ?? "the worker did not start"}`);
    };
    workers.push(worker);
    return worker;
  }

  function leastBusy() {
    const wanted = Math.min(kMaxWorkers, Math.max(1, (navigator.hardwareConcurrency ?? 2) - 1));
    const worker = workers.reduce((a, b) => (a && a.busy <= b.busy ? a : b), null);
    return worker && (worker.busy === 0 || workers.length >= wanted) ? worker : start();
  }

  return function decode(low, high, bytes) {
    const worker = leastBusy();
    const job = next++;
    ++worker.busy;
    jobs.set(job, {low, high, worker});
    worker.postMessage({job, wasm: files.wasm, bytes}, [bytes.buffer]);
  };
}
