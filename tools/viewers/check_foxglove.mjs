// Reads a recording with the open code of Foxglove Studio, as published in the npm package @foxglove/studio-base:
// its parser of channels and schemas, its reader of indexed MCAP files, its grammar of message paths.
//
//   node tools/viewers/check_foxglove.mjs FOLDER RECORDING [LAYOUT]
//
// FOLDER is made once, outside of this project:
//   npm install --ignore-scripts @mcap/core @foxglove/rostime @foxglove/wasm-zstd @protobufjs/base64 nearley lodash
//   npm pack @foxglove/studio-base && tar -xzf foxglove-studio-base-*.tgz
//
// Prints one JSON object. Exit code 0: no problem; 1: problems, listed; 77: not checked, FOLDER lacks a package.

import { createRequire } from "node:module";
import fs from "node:fs";
import path from "node:path";

const SKIPPED = 77;
const [folder, recording, layout] = process.argv.slice(2);
if (recording === undefined) {
  console.error("usage: node check_foxglove.mjs FOLDER RECORDING [LAYOUT]");
  process.exit(2);
}

function skip(reason) {
  console.log(`skipped: ${reason}`);
  process.exit(SKIPPED);
}

const studio = path.join(path.resolve(folder), "package");
if (!fs.existsSync(studio)) {
  skip(`no unpacked @foxglove/studio-base in ${folder}/package`);
}
const load = createRequire(path.join(path.resolve(folder), "index.js"));
function library(name) {
  try {
    return load(name);
  } catch (error) {
    return skip(`${name} is not installed in ${folder}: ${error.code ?? error.message}`);
  }
}
const { McapIndexedReader } = library("@mcap/core");
const { fromNanoSec, toNanoSec, compare } = library("@foxglove/rostime");
const zstd = library("@foxglove/wasm-zstd");
const base64 = library("@protobufjs/base64");
const nearley = library("nearley");
const lodash = library("lodash");

/** The text of one source file within a bundle, up to the next one. */
function bundled(text, name) {
  const begin = text.indexOf(`;// CONCATENATED MODULE: ${name}`);
  if (begin < 0) {
    throw new Error(`${name} is not in the bundle`);
  }
  const rest = text.slice(begin + 1);
  const end = rest.search(/\n(;\/\/ CONCATENATED|\/\/ EXTERNAL) MODULE: /);
  return end < 0 ? rest : rest.slice(0, end);
}

/** What a source text defines, given what it imports. */
function evaluated(text, name, imports) {
  const plain = text.replace(/^import .*$/gm, "").replace(/^export (default )?/gm, "");
  return new Function(...Object.keys(imports), `${plain}\nreturn ${name};`)(...Object.values(imports));
}

/** The published parser of channels; it stands in the bundle only. */
function channelParser() {
  const assets = path.join(studio, "assets");
  const bundles = fs.readdirSync(assets).filter((name) => name.endsWith(".js"));
  bundles.sort((a, b) => fs.statSync(path.join(assets, a)).size - fs.statSync(path.join(assets, b)).size);
  const text = bundles
    .map((name) => fs.readFileSync(path.join(assets, name), "utf8"))
    .find((content) => content.includes("MODULE: ../mcap-support/src/parseChannel.ts"));
  const schemas = evaluated(bundled(text, "../mcap-support/src/parseJsonSchema.ts"), "parseJsonSchema", { base64 });
  return evaluated(bundled(text, "../mcap-support/src/parseChannel.ts"), "parseChannel", { parseJsonSchema: schemas });
}

/** Whatever in the package's source folder stands in one file. */
function source(name, result, imports) {
  return evaluated(fs.readFileSync(path.join(studio, "src", name), "utf8"), result, imports);
}

/** The published parser of message paths, from the grammar in the bundle. */
function pathParser() {
  const text = fs.readFileSync(path.join(studio, "assets", "index.js"), "utf8");
  const inside = text.indexOf('"symbols": ["messagePath"]');
  const begin = text.lastIndexOf("// Generated automatically by nearley", inside);
  const module = { exports: {} };
  new Function("module", text.slice(begin, text.indexOf("\n/***/ })", inside)))(module);
  const syntax = "components/MessagePathSyntax";
  const imports = { memoize: lodash.memoize, uniq: lodash.uniq, filterMap: () => [], grammar: module.exports };
  const parse = source(`${syntax}/parseRosPath.js`, "parseRosPath", {
    ...imports,
    Parser: nearley.Parser,
    Grammar: nearley.Grammar,
  });
  const filterMatches = source(`${syntax}/filterMatches.js`, "filterMatches", {});
  const items = source(`${syntax}/simpleGetMessagePathDataItems.js`, "simpleGetMessagePathDataItems", {
    filterMatches,
  });
  return { parse, items };
}

/** Message paths of a layout's panels. */
function pathsOf(file) {
  const panels = Object.values(JSON.parse(fs.readFileSync(file, "utf8")).configById);
  return panels.flatMap((panel) => [
    ...(panel.paths ?? []).map((item) => item.value),
    ...(panel.topicPath ? [panel.topicPath] : []),
  ]);
}

const data = fs.readFileSync(recording);
const readable = {
  size: async () => BigInt(data.length),
  read: async (offset, size) => new Uint8Array(data.subarray(Number(offset), Number(offset + size))),
};
await zstd.isLoaded;
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (buffer, size) => zstd.decompress(buffer, Number(size)) },
});
const Source = source("players/IterablePlayer/Mcap/McapIndexedIterableSource.js", "McapIndexedIterableSource", {
  Logger: { getLogger: () => console },
  parseChannel: channelParser(),
  fromNanoSec,
  toNanoSec,
  compare,
  __filename: "McapIndexedIterableSource",
});
const indexed = new Source(reader);
const { topics, datatypes, problems, start, end } = await indexed.initialize();
const messages = [];
for await (const item of indexed.messageIterator({ topics: topics.map((topic) => topic.name) })) {
  (item.type === "problem" ? problems : messages).push(item.type === "problem" ? item.problem : item.msgEvent);
}
const values = {};
if (layout !== undefined) {
  const { parse, items } = pathParser();
  for (const text of pathsOf(layout)) {
    const parsed = parse(text);
    if (parsed === undefined) {
      problems.push({ message: `${layout}: ${text} is no message path` });
      continue;
    }
    for (const part of parsed.messagePath.filter((step) => step.type === "slice")) {
      [part.start, part.end] = [Number(part.start), Number(part.end)];
    }
    values[text] = messages.flatMap((message) => items(message, parsed)).filter((value) => value != undefined).length;
  }
}
const count = (name) => messages.filter((message) => message.topic === name).length;
const result = {
  topics: Object.fromEntries(topics.map((t) => [t.name, { schema: t.schemaName ?? null, messages: count(t.name) }])),
  fields: Object.fromEntries([...datatypes].map(([name, type]) => [name, type.definitions.map((item) => item.name)])),
  start_ns: String(toNanoSec(start)),
  end_ns: String(toNanoSec(end)),
  ...(layout === undefined ? {} : { values }),
  problems: problems.map((problem) => problem.message + (problem.error ? `: ${problem.error.message}` : "")),
};
console.log(JSON.stringify(result, null, 1));
process.exit(problems.length > 0 ? 1 : 0);
