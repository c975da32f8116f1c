// Search a built site as its page does: node tools/search_site.js SITE QUERY...
// Prints a JSON list of the pages for each query, the best first. Sphinx's own script does the searching.
const fs = require("fs");
const path = require("path");
const vm = require("vm");

const [site, ...queries] = process.argv.slice(2);
const nothing = () => null;
const context = vm.createContext({
  document: { getElementById: nothing, addEventListener: nothing, querySelectorAll: () => [] },
  addEventListener: nothing,
  _ready: nothing,
  _: (text) => text,
  SPHINX_HIGHLIGHT_ENABLED: false,
  queries,
});
vm.runInContext("var window = globalThis;", context);
for (const name of ["_static/language_data.js", "_static/searchtools.js", "searchindex.js"]) {
  vm.runInContext(fs.readFileSync(path.join(site, name), "utf8"), context);
}
const found = vm.runInContext(
  "queries.map((query) => Search._performSearch(...Search._parseQuery(query)).reverse().map((result) => result[0]))",
  context,
);
console.log(JSON.stringify(found));
