// The order of the pages that contain a word: first its meaning, then the guides, and the lists at the end.
const ORDER = { glossary: 4, "first-evening": 2, benchmarks: -2, changelog: -3 };
var Scorer = {
  score: ([page, , , , score]) => score + (ORDER[page] ?? (page.startsWith("reference/") ? -3 : 0)),
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
