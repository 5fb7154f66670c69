#include <lz4frame.h>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include "client_sdk/capture/mcap_reader.h"
#include "client_sdk/capture/mcap_writer.h"
#include "tests/unit/capture/memory_file.h"

namespace rustle::capture::mcap_test {
namespace {

struct Stored {
  std::string topic;
  std::uint32_t sequence;
  std::uint64_t log_time_ns;
  std::string data;
  bool operator==(const Stored&) const = default;
};

struct ReadBack {
  bool opened = false;
  std::string error;
  std::vector<Stored> messages;
  Recovery recovery;
};

ReadBack read_back(std::string_view bytes) {
  ReadBack out;
  auto reader = McapReader::open(std::make_unique<MemoryInputFile>(bytes));
  if (!reader) {
    out.error = reader.error();
    return out;
  }
  out.opened = true;
  while (auto read = reader->next()) {
    out.messages.push_back(
        {read->channel->topic, read->message.sequence, read->message.log_time_ns, std::string(read->message.data)});
  }
  out.recovery = reader->recovery();
  return out;
}

/// 24 messages on two topics, 40 ms apart, in chunks of up to 250 ms.
std::vector<Stored> example_messages() {
  std::vector<Stored> messages;
  for (std::uint32_t i = 0; i < 24; ++i) {
    messages.push_back(
        {i % 3 == 0 ? "/a" : "/b", i + 1, 40'000'000ull * i, fmt::format("message {} {}", i, std::string(i, 'x'))});
  }
  return messages;
}

struct ChunkEnd {
  std::size_t bytes;     ///< of the chunk record itself, without its indexes
  std::size_t messages;  ///< up to it
};

/// Where the chunks of a file written by McapWriter end, by walking over its records.
std::vector<ChunkEnd> chunk_ends(std::string_view file) {
  std::vector<ChunkEnd> ends;
  std::size_t position = kMcapMagic.size();
  std::size_t messages = 0;
  while (position + kMcapRecordPrefix <= file.size()) {
    FieldReader fields(file.substr(position));
    const auto opcode = static_cast<McapOpcode>(fields.value<std::uint8_t>());
    const auto length = fields.value<std::uint64_t>();
    if (opcode == McapOpcode::kDataEnd) break;
    const std::string_view content = fields.bytes(length);
    position += kMcapRecordPrefix + length;
    if (opcode == McapOpcode::kChunk) ends.push_back({position, messages});
    if (opcode == McapOpcode::kMessageIndex) {
      FieldReader index(content);
      index.value<std::uint16_t>();
      messages += index.value<std::uint32_t>() / 16;
      ends.back().messages = messages;
    }
  }
  return ends;
}

void write_examples(McapWriter& writer) {
  const auto schema = writer.add_schema("schema", "protobuf", "not looked at");
  REQUIRE(schema);
  const auto a = writer.add_channel(*schema, "/a", "protobuf");
  const auto b = writer.add_channel(*schema, "/b", "protobuf");
  REQUIRE(a);
  REQUIRE(b);
  for (const Stored& each : example_messages()) {
    REQUIRE(writer.write({each.topic == "/a" ? *a : *b, each.sequence, each.log_time_ns, each.log_time_ns, each.data}));
  }
}

std::string example_file(Compression compression) {
  auto disk = std::make_shared<MemoryDisk>();
  McapWriterOptions options;
  options.compression = compression;
  McapWriter writer(std::make_unique<MemoryOutputFile>(disk), options);
  REQUIRE(writer.add_metadata({"rustle", {{"wire_version", "1"}}}));
  write_examples(writer);
  REQUIRE(writer.close());
  return disk->bytes;
}

}  // namespace

TEST_CASE("what was written is read back, compressed or not") {
  const auto compression = GENERATE(Compression::kNone, Compression::kZstd);
  const std::string file = example_file(compression);
  const ReadBack read = read_back(file);
  REQUIRE(read.opened);
  CHECK(read.messages == example_messages());
  CHECK(read.recovery.complete);
  CHECK(read.recovery.what.empty());
  CHECK(read.recovery.bytes_read == file.size());
  // 24 messages, 40 ms apart: seven fit into less than 250 ms.
  CHECK(chunk_ends(file).size() == 4);
}

TEST_CASE("the same messages make the same bytes") {
  CHECK(example_file(Compression::kZstd) == example_file(Compression::kZstd));
}

TEST_CASE("every prefix of a file gives every message of its whole chunks") {
  const auto compression = GENERATE(Compression::kNone, Compression::kZstd);
  const std::string file = example_file(compression);
  const std::vector<ChunkEnd> ends = chunk_ends(file);
  const std::vector<Stored> messages = example_messages();
  std::size_t mistakes = 0;
  for (std::size_t length = 0; length < file.size(); ++length) {
    std::size_t expected = 0;
    for (const ChunkEnd& end : ends) {
      if (end.bytes <= length) expected = end.messages;
    }
    const ReadBack read = read_back(std::string_view(file).substr(0, length));
    if (!read.opened) {
      if (expected > 0 || read.error.find("recording.mcap") == std::string::npos) ++mistakes;
      continue;
    }
    const bool right =
        read.messages.size() == expected && std::equal(read.messages.begin(), read.messages.end(), messages.begin());
    if (!right || read.recovery.complete || read.recovery.what.empty() || read.recovery.bytes_read > length) ++mistakes;
  }
  CHECK(mistakes == 0);
}

TEST_CASE("any flipped bit is noticed and costs nothing before its chunk") {
  const auto compression = GENERATE(Compression::kNone, Compression::kZstd);
  const std::string file = example_file(compression);
  const std::vector<ChunkEnd> ends = chunk_ends(file);
  const std::vector<Stored> messages = example_messages();
  std::size_t unnoticed = 0;
  std::size_t lost = 0;
  const std::size_t step = compression == Compression::kZstd ? 3 : 1;
  for (std::size_t bit = 0; bit < 8 * file.size(); bit += step) {
    std::string damaged = file;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    const ReadBack read = read_back(damaged);
    if (read.opened && read.recovery.complete) ++unnoticed;
    std::size_t safe = 0;
    for (const ChunkEnd& end : ends) {
      if (end.bytes <= bit / 8) safe = end.messages;
    }
    if (read.messages.size() < safe) ++lost;
    for (std::size_t i = 0; i < std::min(safe, read.messages.size()); ++i) {
      if (!(read.messages[i] == messages[i])) ++lost;
    }
  }
  CHECK(unnoticed == 0);
  CHECK(lost == 0);
}

TEST_CASE("what is no MCAP file is refused by name") {
  const auto bytes = GENERATE(as<std::string>(), "", "RIFF....WAVEfmt ", "\x89PNG\r\n\x1a\n",
                              std::string("\x89MCAP1\r\n", 8), std::string(kMcapMagic) + std::string(20, '\0'));
  const ReadBack read = read_back(bytes);
  CHECK_FALSE(read.opened);
  CHECK(read.error.find("recording.mcap: ") == 0);
}

TEST_CASE("lengths beyond reason are refused before memory is taken for them") {
  std::string file(kMcapMagic);
  append_header(file, {"", "test"});
  SECTION("of a record") {
    file.push_back(static_cast<char>(McapOpcode::kChunk));
    append_value(file, std::uint64_t{1} << 60);
    file.append(100, 'x');
  }
  SECTION("of what a chunk unpacks to") {
    append_chunk(file, {0, 0, std::uint64_t{1} << 40, 0, "zstd", "xxxx"});
  }
  SECTION("of what a chunk really unpacks to") {
    const std::string zeros(1 << 20, '\0');
    append_chunk(file, {0, 0, 1000, 0, "zstd", compress(zeros, Compression::kZstd, 1)});
  }
  SECTION("of a record within a chunk") {
    std::string records(1, static_cast<char>(McapOpcode::kMessage));
    append_value(records, std::uint64_t{1} << 62);
    append_chunk(file, {0, 0, records.size(), 0, "", records});
  }
  SECTION("of an unknown compression") {
    append_chunk(file, {0, 0, 4, 0, "rot13", "abcd"});
  }
  const ReadBack read = read_back(file);
  REQUIRE(read.opened);
  CHECK(read.messages.empty());
  CHECK_FALSE(read.recovery.complete);
  CHECK(read.recovery.what.find("recording.mcap") == 0);
}

TEST_CASE("files of other writers are read: no chunks, lz4, attachments, unknown records, no summary") {
  std::string records;
  append_schema(records, {1, "schema", "protobuf", ""});
  append_channel(records, {1, 1, "/a", "protobuf", {{"key", "value"}}});
  for (std::uint32_t i = 1; i <= 5; ++i) append_message(records, {1, i, i, i, "data"});

  std::string file(kMcapMagic);
  append_header(file, {"ros2", "another writer"});
  file.push_back(static_cast<char>(McapOpcode::kAttachment));
  append_value(file, std::uint64_t{3'000'000});
  file.append(3'000'000, 'a');
  file.push_back(static_cast<char>(0x90));
  append_value(file, std::uint64_t{3});
  file.append("abc");
  SECTION("not in chunks") {
    file += records;
  }
  SECTION("in an lz4 chunk") {
    std::string packed(LZ4F_compressFrameBound(records.size(), nullptr), '\0');
    packed.resize(LZ4F_compressFrame(packed.data(), packed.size(), records.data(), records.size(), nullptr));
    append_chunk(file, {1, 5, records.size(), crc32_of(records), "lz4", packed});
  }
  SECTION("in a chunk without checksum") {
    append_chunk(file, {1, 5, records.size(), 0, "", records});
  }
  append_data_end(file, 0);
  append_footer(file, file.size(), {});
  file += kMcapMagic;
  const ReadBack read = read_back(file);
  REQUIRE(read.opened);
  CHECK(read.recovery.what == "");
  CHECK(read.recovery.complete);
  REQUIRE(read.messages.size() == 5);
  CHECK(read.messages[4] == Stored{"/a", 5, 5, "data"});
}

TEST_CASE("a channel declared twice, differently, is damage: which of both is right cannot be known") {
  std::string records;
  append_channel(records, {1, 1, "/a", "protobuf", {}});
  append_message(records, {1, 1, 1, 1, "data"});
  std::string file(kMcapMagic);
  append_header(file, {"", ""});
  append_schema(file, {1, "schema", "protobuf", ""});
  append_channel(file, {1, 1, "/b", "protobuf", {}});
  append_chunk(file, {1, 1, records.size(), crc32_of(records), "", records});
  const ReadBack read = read_back(file);
  CHECK(read.messages.empty());
  CHECK_FALSE(read.recovery.complete);
  CHECK(read.recovery.what.find("channel 1 is declared twice, differently") != std::string::npos);
}

TEST_CASE("a chunk closes at its size") {
  auto disk = std::make_shared<MemoryDisk>();
  McapWriterOptions options;
  options.compression = Compression::kNone;
  McapWriter writer(std::make_unique<MemoryOutputFile>(disk), options);
  const auto schema = writer.add_schema("s", "protobuf", "");
  const auto channel = writer.add_channel(*schema, "/a", "protobuf");
  const std::string data(300'000, 'x');
  for (std::uint32_t i = 0; i < 10; ++i) REQUIRE(writer.write({*channel, i, 0, 0, data}));
  REQUIRE(writer.close());
  const std::vector<ChunkEnd> ends = chunk_ends(disk->bytes);
  REQUIRE(ends.size() == 3);
  CHECK(ends[0].messages == 4);
  CHECK(ends[2].messages == 10);
}

TEST_CASE("a pausing stream's chunk closes by the caller's clock") {
  auto disk = std::make_shared<MemoryDisk>();
  McapWriter writer(std::make_unique<MemoryOutputFile>(disk), {});
  write_examples(writer);
  REQUIRE_FALSE(writer.open_chunk_is_empty());
  const std::uint64_t first_ns = example_messages()[21].log_time_ns;
  REQUIRE(writer.close_chunk_before(first_ns + 249'999'999));
  CHECK_FALSE(writer.open_chunk_is_empty());
  REQUIRE(writer.close_chunk_before(first_ns + 250'000'000));
  CHECK(writer.open_chunk_is_empty());
  CHECK(read_back(disk->bytes).messages.size() == 24);
}

TEST_CASE("whichever operation fails, the error names file and remedy and what was synced can be read") {
  const bool for_good = GENERATE(false, true);
  int failures_met = 0;
  for (int failing = 0; failing < 60; ++failing) {
    auto disk = std::make_shared<MemoryDisk>();
    disk->failing_operation = failing;
    disk->fails_from_then_on = for_good;
    bool failed = false;
    std::size_t synced = 0;
    const auto note = [&](const auto& result) {
      if (result) return true;
      failed = true;
      CHECK(result.error().file_name == "recording.mcap");
      CHECK(result.error().message.find("No space") != std::string::npos);
      CHECK(result.error().remedy.find("free space") != std::string::npos);
      return false;
    };
    {
      McapWriter writer(std::make_unique<MemoryOutputFile>(disk), {});
      const auto schema = writer.add_schema("schema", "protobuf", "");
      if (note(schema)) {
        const auto channel = writer.add_channel(*schema, "/a", "protobuf");
        if (note(channel)) {
          const std::vector<Stored> messages = example_messages();
          for (std::size_t i = 0; i < messages.size(); ++i) {
            const bool after_failure = failed;
            const bool written =
                note(writer.write({*channel, messages[i].sequence, messages[i].log_time_ns, 0, messages[i].data}));
            CHECK_FALSE((after_failure && written));
            if (i % 5 == 4 && note(writer.sync())) synced = i + 1;
          }
        }
      }
      note(writer.close());
      CHECK(writer.close());
      CHECK(disk->closed);
    }
    failures_met += failed ? 1 : 0;
    const ReadBack read = read_back(disk->bytes);
    CHECK(read.messages.size() >= synced);
    if (!failed) CHECK((read.recovery.complete && read.messages.size() == 24));
    // One failing write leaves room to finish the file behind the last whole chunk.
    if (read.opened && !for_good && failing > 3 && read.messages.size() < 24) CHECK(read.recovery.complete);
  }
  CHECK(failures_met > 10);
}

TEST_CASE("a full device is reported, not thrown") {
  if (!std::filesystem::exists("/dev/full")) return;
  auto file = create_file("/dev/full");
  REQUIRE(file);
  McapWriter writer(std::move(*file), {});
  const auto schema = writer.add_schema("schema", "protobuf", "");
  REQUIRE_FALSE(schema);
  CHECK(schema.error().text().find("/dev/full: cannot write: No space left on device; free space") == 0);
  CHECK_FALSE(writer.close());
}

TEST_CASE("a file that cannot be made or opened says why") {
  const auto made = create_file("/nowhere/at/all.mcap");
  REQUIRE_FALSE(made);
  CHECK(made.error().text().find("/nowhere/at/all.mcap") == 0);
  const auto opened = open_file("/tmp");
  REQUIRE_FALSE(opened);
  CHECK(opened.error().remedy == "give a file, not a folder");
}

}  // namespace rustle::capture::mcap_test
