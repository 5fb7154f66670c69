#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>

#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/dynamic_message.h>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include "client_sdk/capture/capture_reader.h"
#include "client_sdk/capture/capture_writer.h"
#include "tests/unit/capture/memory_file.h"
#include "tests/unit/capture/small_capture.h"

namespace rustle::capture::capture_test {
namespace {

std::vector<CaptureRecord> small_records() {
  std::vector<CaptureRecord> records;
  for (const TimedMessage& each : small_session()) {
    const auto log_time_ns = static_cast<std::uint64_t>(each.time_s * 1e9);
    records.push_back(record_of(each.message, log_time_ns, log_time_ns));
  }
  return records;
}

bool same(const CaptureRecord& a, const CaptureRecord& b) {
  return a.topic == b.topic && a.log_time_ns == b.log_time_ns && a.publish_time_ns == b.publish_time_ns &&
         a.sequence == b.sequence && a.bytes == b.bytes && a.kind == b.kind;
}

struct ReadBack {
  std::vector<CaptureRecord> records;
  Recovery recovery;
};

ReadBack read_back(std::string_view bytes) {
  auto reader = CaptureReader::open(std::make_unique<MemoryInputFile>(bytes));
  if (!reader) return {{}, {false, reader.error(), 0}};
  ReadBack out;
  while (auto record = reader->next()) out.records.push_back(std::move(*record));
  out.recovery = reader->recovery();
  return out;
}

}  // namespace

TEST_CASE("a topic for every kind of message") {
  v1::StreamMessage message;
  message.set_session_id("S");
  CHECK(topic_of(message) == "/S/other");
  message.mutable_announcement();
  CHECK(topic_of(message) == "/S/announcement");
  message.mutable_sheet();
  CHECK(topic_of(message) == "/S/sheet");
  message.mutable_topology();
  CHECK(topic_of(message) == "/S/topology");
  message.mutable_frame()->set_sheet_id(7);
  CHECK(topic_of(message) == "/S/frame/7");
  message.mutable_scene();
  CHECK(topic_of(message) == "/S/scene");
  message.mutable_listener();
  CHECK(topic_of(message) == "/S/listener");
  message.mutable_advance();
  CHECK(topic_of(message) == "/S/advance");
  message.mutable_end();
  CHECK(topic_of(message) == "/S/end");
  message.mutable_tear_tips();
  CHECK(topic_of(message) == "/S/tear_tips");
  v1::Decision decision;
  decision.set_session_id("S");
  CHECK(topic_of(decision) == "/S/decision");
}

TEST_CASE("a capture gives back every record as it was, decisions and malformed bytes too") {
  std::vector<CaptureRecord> records = small_records();
  v1::Decision decision;
  decision.set_session_id("small");
  decision.set_sequence(1);
  decision.mutable_dropped()->set_message_sequence(6);
  records.insert(records.begin() + 7, record_of(decision, records[6].log_time_ns));
  records.insert(records.begin() + 9,
                 {"/small/other", records[8].log_time_ns, 3, 9, "\xff\xff\xff no message", Kind::kStreamMessage});
  records.insert(records.begin() + 9, {"/small/other", records[8].log_time_ns, 3, 9, "", Kind::kStreamMessage});

  auto disk = std::make_shared<MemoryDisk>();
  CaptureWriterOptions options;
  options.notes["source"] = "a test";
  auto writer = CaptureWriter::create(std::make_unique<MemoryOutputFile>(disk), options);
  REQUIRE(writer);
  for (const CaptureRecord& record : records) REQUIRE(writer->write(record));
  const auto totals = writer->close();
  REQUIRE(totals);
  CHECK(totals->messages == records.size());
  CHECK(totals->bytes == disk->bytes.size());

  const ReadBack read = read_back(disk->bytes);
  CHECK(read.recovery.complete);
  REQUIRE(read.records.size() == records.size());
  for (std::size_t i = 0; i < records.size(); ++i) CHECK(same(read.records[i], records[i]));
  auto reader = CaptureReader::open(std::make_unique<MemoryInputFile>(disk->bytes));
  REQUIRE(reader);
  CHECK(reader->notes() == std::map<std::string, std::string>{{"source", "a test"}, {"wire_version", "1"}});

  SECTION("cut anywhere it gives a beginning of it") {
    std::size_t most = 0;
    for (std::size_t length = 0; length < disk->bytes.size(); length += 37) {
      const ReadBack cut = read_back(std::string_view(disk->bytes).substr(0, length));
      CHECK_FALSE(cut.recovery.complete);
      CHECK(cut.records.size() >= most);
      most = cut.records.size();
      bool equal = true;
      for (std::size_t i = 0; i < cut.records.size(); ++i) equal = equal && same(cut.records[i], records[i]);
      CHECK(equal);
    }
    CHECK(most == records.size());
  }
}

TEST_CASE("the schema in the file is enough to read a message") {
  auto disk = std::make_shared<MemoryDisk>();
  auto writer = CaptureWriter::create(std::make_unique<MemoryOutputFile>(disk));
  REQUIRE(writer);
  for (const CaptureRecord& record : small_records()) REQUIRE(writer->write(record));
  REQUIRE(writer->close());

  auto reader = McapReader::open(std::make_unique<MemoryInputFile>(disk->bytes));
  REQUIRE(reader);
  std::string bytes;
  const McapSchema* schema = nullptr;
  while (auto read = reader->next()) {
    if (read->channel->topic != "/small/frame/1") continue;
    bytes = read->message.data;
    schema = read->schema;
  }
  REQUIRE(schema != nullptr);
  CHECK(schema->name == "rustle.v1.StreamMessage");
  CHECK(schema->encoding == "protobuf");
  google::protobuf::FileDescriptorSet set;
  REQUIRE(set.ParseFromString(schema->data));
  google::protobuf::DescriptorPool pool;
  for (const auto& file : set.file()) REQUIRE(pool.BuildFile(file) != nullptr);
  const auto* type = pool.FindMessageTypeByName(schema->name);
  REQUIRE(type != nullptr);
  google::protobuf::DynamicMessageFactory factory(&pool);
  const std::unique_ptr<google::protobuf::Message> message(factory.GetPrototype(type)->New());
  REQUIRE(message->ParseFromString(bytes));
  CHECK(message->SerializeAsString() == bytes);
}

TEST_CASE("sync tells the highest sequence number that is stored") {
  auto disk = std::make_shared<MemoryDisk>();
  auto writer = CaptureWriter::create(std::make_unique<MemoryOutputFile>(disk));
  REQUIRE(writer);
  CHECK(writer->sync().value() == 0);
  CaptureRecord record{"/s/advance", 0, 0, 1, "x", Kind::kStreamMessage};
  const auto write = [&](std::uint32_t sequence, Kind kind) {
    record.sequence = sequence;
    record.kind = kind;
    REQUIRE(writer->write(record));
  };
  write(5, Kind::kStreamMessage);
  write(4, Kind::kStreamMessage);
  write(1000, Kind::kDecision);
  CHECK(writer->sync().value() == 5);
  CHECK(read_back(disk->bytes).records.size() == 3);

  auto late = CaptureWriter::create(std::make_unique<MemoryOutputFile>(std::make_shared<MemoryDisk>()));
  record.sequence = 0xfffffffe;
  record.kind = Kind::kStreamMessage;
  REQUIRE(late->write(record));
  record.sequence = 2;
  REQUIRE(late->write(record));
  CHECK(late->sync().value() == 0x100000002ull);
}

TEST_CASE("other programs' files and newer wires") {
  auto disk = std::make_shared<MemoryDisk>();
  McapWriter writer(std::make_unique<MemoryOutputFile>(disk), {});
  SECTION("none of Rustle's messages") {
    const auto schema = writer.add_schema("sensor_msgs/Image", "ros2msg", "");
    const auto channel = writer.add_channel(*schema, "/camera", "cdr");
    REQUIRE(writer.write({*channel, 1, 0, 0, "x"}));
    REQUIRE(writer.close());
    const auto reader = CaptureReader::open(std::make_unique<MemoryInputFile>(disk->bytes));
    REQUIRE_FALSE(reader);
    CHECK(reader.error().find("none of its 1 messages is Rustle's") != std::string::npos);
  }
  SECTION("a newer wire") {
    REQUIRE(writer.add_metadata({"rustle", {{"wire_version", "2"}}}));
    REQUIRE(writer.close());
    const auto reader = CaptureReader::open(std::make_unique<MemoryInputFile>(disk->bytes));
    REQUIRE_FALSE(reader);
    CHECK(reader.error().find("newer Rustle") != std::string::npos);
  }
}

// Run by hand, with the file to write in RUSTLE_SMALL_CAPTURE: the stored file of version 1 itself is never made again.
TEST_CASE("write the small capture", "[.write-small-capture]") {
  const char* const path = std::getenv("RUSTLE_SMALL_CAPTURE");
  REQUIRE(path != nullptr);
  CaptureWriterOptions options;
  options.notes["source"] = "procedural sheet";
  auto writer = CaptureWriter::create(path, options);
  REQUIRE(writer);
  for (const CaptureRecord& record : small_records()) REQUIRE(writer->write(record));
  REQUIRE(writer->close());
}

TEST_CASE("the stored capture of version 1 is read for good") {
  const std::filesystem::path path = std::filesystem::path(RUSTLE_SOURCE_DIR) / "tests/golden/capture/v1_small.mcap";
  auto reader = CaptureReader::open(path);
  REQUIRE(reader);
  std::map<std::string, int> counts;
  std::uint64_t sequence = 0;
  while (const auto record = reader->next()) {
    v1::StreamMessage message;
    REQUIRE(message.ParseFromString(record->bytes));
    CHECK(message.sequence() == ++sequence);
    CHECK(record->topic == topic_of(message));
    ++counts[record->topic];
    if (message.has_frame()) {
      CHECK(message.frame().positions().size() == 42 * 12);
      CHECK(message.frame().anchored().size() == 42);
      CHECK(message.frame().time_s() == Approx(static_cast<double>(record->log_time_ns) * 1e-9).margin(1e-9));
    }
    if (message.has_topology()) CHECK(message.topology().triangles().size() == 60 * 12);
  }
  CHECK(reader->recovery().complete);
  CHECK(counts == std::map<std::string, int>{{"/small/advance", 1},
                                             {"/small/announcement", 1},
                                             {"/small/end", 1},
                                             {"/small/frame/1", 46},
                                             {"/small/listener", 1},
                                             {"/small/scene", 1},
                                             {"/small/sheet", 1},
                                             {"/small/topology", 1}});
  CHECK(std::filesystem::file_size(path) < 150'000);
}

}  // namespace rustle::capture::capture_test
