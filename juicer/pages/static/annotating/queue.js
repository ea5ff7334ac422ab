// What is to be judged: one entry for each critical state of each demonstration, those in doubt first.

export const SURE = 0.9;
export const AGREEMENTS_BEFORE_OFFER = 5;
export const SAMPLE = 5;

export class Queue {
  constructor(episodes) {
    this.entries = episodes.flatMap((episode) => episode.marks.map((mark) => ({
      ...mark, episode, state: mark.critical_state, cursor: null, pending: null, sampled: false, judged: false,
    })));
  }

  /** Take over what the server says stands; answers may come in another order than what they tell of. */
  update(marks) {
    for (const mark of marks) {
      const entry = this.entries.find((each) => each.episode.id === mark.episode && each.state === mark.critical_state);
      if (entry && mark.newest >= entry.newest) Object.assign(entry, { newest: mark.newest, opinions: mark.opinions, agreed: mark.agreed, disputed: mark.disputed });
    }
  }

  /** Whether an entry is among those that are to be shown. */
  isWanted(entry, which, author) {
    if (entry.pending) return Boolean(entry.pending.refused);
    if (which === "all") return !entry.judged;
    if (which === "disputed") return entry.disputed;
    // What was not found in a correction may lie before its beginning; it can be marked among all.
    if (!entry.expected && !entry.opinions.length) return false;
    if (which === "mine") return !own(entry, author);
    return entry.opinions.length === 0;
  }

  wanted(which, author) {
    return this.entries.filter((entry) => this.isWanted(entry, which, author));
  }

  /** The next wanted entry after one, from the start again at the end; those of a sample come first. */
  next(after, which, author) {
    const place = after ? this.entries.indexOf(after) : -1;
    const order = [...this.entries.slice(place + 1), ...this.entries.slice(0, place + 1)];
    const wanted = order.filter((entry) => this.isWanted(entry, which, author));
    return wanted.find((entry) => entry.sampled) ?? wanted[0] ?? null;
  }

  /** What may be accepted together. */
  sure(which, author) {
    return this.wanted(which, author).filter((entry) => entry.proposal && entry.proposal.confidence > SURE);
  }
}

/** An annotator's own mark, if it stands. */
export function own(entry, author) {
  return entry.opinions.find((opinion) => opinion.author === author);
}

/** Where to begin to look. */
export function startOf(entry, author) {
  return entry.cursor ?? entry.pending?.step ?? own(entry, author)?.step ?? entry.proposal?.step
    ?? entry.opinions[0]?.step ?? Math.floor(entry.episode.steps / 2);
}

/** Some of them, drawn at random. */
export function sampleOf(entries, count) {
  const rest = [...entries];
  return Array.from({ length: Math.min(count, rest.length) }, () => rest.splice(Math.floor(Math.random() * rest.length), 1)[0]);
}
