// The line to a host, which may be down for a while: whatever is asked for waits then, and is asked for again.

/** Waits, ms: twice as long each time, up to the longest. */
const SOON = 1000;
const LONGEST = 30000;

export class Line {
  /** @param hear.lost the host cannot be reached; it is asked again, and `hear.found` told when it answers */
  constructor(hear) {
    Object.assign(this, { hear, stopped: new AbortController(), losses: 0, waiting: null });
  }

  get signal() {
    return this.stopped.signal;
  }

  close() {
    this.stopped.abort();
  }

  /** What `work` comes to, as often as it takes to reach the host. */
  async reach(work) {
    for (;;) {
      try {
        const done = await work(this.signal);
        if (this.losses > 0 && !this.signal.aborted) this.hear.found();
        this.losses = 0;
        return done;
      } catch (error) {
        if (!error.isLost || this.signal.aborted) throw error;
        await this.#wait(error);
      }
    }
  }

  /** All that is under way waits together. */
  async #wait(error) {
    if (!this.waiting) {
      this.hear.lost(error);
      this.waiting = this.#pause(Math.min(SOON * 2 ** this.losses++, LONGEST));
    }
    await this.waiting;
    this.waiting = null;
  }

  #pause(time) {
    return new Promise((done) => {
      const go = () => {
        clearTimeout(timer);
        removeEventListener("online", go);
        this.signal.removeEventListener("abort", go);
        done();
      };
      const timer = setTimeout(go, time);
      addEventListener("online", go);
      this.signal.addEventListener("abort", go);
    });
  }
}
