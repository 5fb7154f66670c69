// Opens captures with the official MCAP readers, by index and as a stream, and prints what they hold as JSON.
// usage: node check_mcap.mjs FILE...
// Exit status: 0 all well, 1 a file that the readers refuse or that does not agree with itself, 2 wrong usage.
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";
import { open, readFile } from "node:fs/promises";

const decompressHandlers = {
  zstd: (buffer, size) => decompress(buffer, new Uint8Array(Number(size))),
};

function fail(message) {
  throw new Error(message);
}

function count(counts, topic) {
  counts.set(topic, (counts.get(topic) ?? 0) + 1);
}

function sorted(counts) {
  return Object.fromEntries([...counts].sort(([a], [b]) => (a < b ? -1 : 1)));
}

async function readByIndex(path) {
  const file = await open(path);
  try {
    const readable = {
      size: async () => BigInt((await file.stat()).size),
      read: async (offset, length) => {
        const buffer = new Uint8Array(Number(length));
        const { bytesRead } = await file.read(buffer, 0, buffer.length, Number(offset));
        return bytesRead === buffer.length ? buffer : fail(`cut at byte ${Number(offset) + bytesRead}`);
      },
    };
    const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
    const counts = new Map();
    for await (const message of reader.readMessages({ validateCrcs: true })) {
      count(counts, reader.channelsById.get(message.channelId).topic);
    }
    const metadata = {};
    for await (const record of reader.readMetadata()) {
      metadata[record.name] = Object.fromEntries(record.metadata);
    }
    return { reader, counts, metadata };
  } finally {
    await file.close();
  }
}

async function readAsStream(path) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(new Uint8Array(await readFile(path)));
  const channels = new Map();
  const schemas = new Map();
  const counts = new Map();
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") {
      schemas.set(record.id, record);
    } else if (record.type === "Channel") {
      channels.set(record.id, record);
    } else if (record.type === "Message") {
      count(counts, channels.get(record.channelId)?.topic ?? fail(`a message of undeclared channel ${record.channelId}`));
    }
  }
  if (!reader.done()) {
    fail("the stream ends before the file's last magic bytes");
  }
  return { counts, schemas };
}

async function check(path) {
  const indexed = await readByIndex(path);
  const streamed = await readAsStream(path);
  const topics = sorted(streamed.counts);
  if (JSON.stringify(sorted(indexed.counts)) !== JSON.stringify(topics)) {
    fail("the indexed and the streaming reader find different messages");
  }
  const messages = Object.values(topics).reduce((sum, n) => sum + n, 0);
  const statistics = indexed.reader.statistics ?? fail("has no statistics");
  if (Number(statistics.messageCount) !== messages) {
    fail(`states ${statistics.messageCount} messages and holds ${messages}`);
  }
  for (const channel of indexed.reader.channelsById.values()) {
    const stated = Number(statistics.channelMessageCounts.get(channel.id) ?? 0n);
    if (stated !== (topics[channel.topic] ?? 0)) {
      fail(`states ${stated} messages on ${channel.topic} and holds ${topics[channel.topic] ?? 0}`);
    }
    const schema = streamed.schemas.get(channel.schemaId) ?? fail(`${channel.topic} has no schema`);
    if (channel.messageEncoding !== "protobuf" || schema.encoding !== "protobuf") {
      fail(`${channel.topic} is not declared as protobuf`);
    }
  }
  return {
    file: path,
    library: indexed.reader.header.library,
    metadata: indexed.metadata,
    schemas: [...streamed.schemas.values()].map((schema) => schema.name),
    chunks: indexed.reader.chunkIndexes.length,
    messages,
    topics,
  };
}

const paths = process.argv.slice(2);
if (paths.length === 0 || paths.includes("--help")) {
  console.error("usage: node check_mcap.mjs FILE...");
  process.exit(paths.length === 0 ? 2 : 0);
}
for (const path of paths) {
  try {
    console.log(JSON.stringify(await check(path)));
  } catch (error) {
    console.error(`${path}: ${error.message}`);
    process.exitCode = 1;
  }
}
