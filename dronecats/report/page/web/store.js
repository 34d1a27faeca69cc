// The data of the page: the index at once, a flight on demand.

export const index = JSON.parse(document.getElementById("index").textContent);

export const episodes = index.episodes.map((episode, number) => {
  const run = index.runs[episode.run];
  return { ...episode, number, runKey: run.key, seed: run.seed, rendered: run.rendered, entrant: run.entrant, address: `${run.key}/${episode.key}` };
});
const byAddress = new Map(episodes.map((episode) => [episode.address, episode]));
const flights = new Map(); // address → promise of the flight
const waiting = new Map(); // address → function that receives the flight

// called by the files in data/
window.dronecatsFlight = (address, flight) => {
  const receive = waiting.get(address);
  waiting.delete(address);
  if (receive) receive(flight);
};

export function outcomeWords(outcome) {
  return index.outcomes[outcome] || ["?", outcome];
}

export function episodeAt(run, key) {
  return byAddress.get(`${run}/${key}`) || null;
}

export function flightsOf(entrant, cell) {
  return episodes.filter((episode) => episode.entrant === entrant && (!cell || episode.cell === cell));
}

export function rate(flights) {
  const counted = flights.filter((flight) => flight.counted);
  return { won: counted.filter((flight) => flight.outcome === "success").length, of: counted.length, all: flights.length };
}

export function rivals(episode) {
  return episodes.filter((other) => other.id === episode.id && other.number !== episode.number && other.shown);
}

export function runTitle(episode) {
  const entrant = index.entrants[episode.entrant];
  return entrant.runs.length > 1 ? `${entrant.title}, flight ${1 + entrant.runs.indexOf(episode.run)}` : entrant.title;
}

export function flightOf(episode) {
  const address = episode.address;
  if (!flights.has(address)) flights.set(address, index.embedded ? embedded(address) : beside(address));
  return flights.get(address);
}

function beside(address) {
  return new Promise((take, refuse) => {
    waiting.set(address, take);
    const script = document.createElement("script");
    script.src = `data/${address}.js`;
    script.onload = () => script.remove();
    script.onerror = () => {
      flights.delete(address);
      refuse(new Error(`data/${address}.js cannot be read: it belongs beside this page`));
    };
    document.head.append(script);
  });
}

async function embedded(address) {
  const block = () => document.getElementById(`flight:${address}`);
  if (!block() && document.readyState === "loading") {
    await new Promise((go) => document.addEventListener("DOMContentLoaded", go, { once: true }));
  }
  if (!block()) throw new Error(`${address} is not in this page`);
  return JSON.parse(block().textContent);
}
