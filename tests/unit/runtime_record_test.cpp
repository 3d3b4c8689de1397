#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>

#include "runtime/record_file.hpp"

namespace softhand::runtime_record_test {
namespace {

std::span<const std::byte> bytes(std::string_view text) { return std::as_bytes(std::span(text.data(), text.size())); }
std::string text_of(const std::vector<std::byte>& data) {
  return {reinterpret_cast<const char*>(data.data()), data.size()};
}

class RecordFile : public testing::Test {
 protected:
  RecordFile()
      : path_(testing::TempDir() + "softhand_" + testing::UnitTest::GetInstance()->current_test_info()->name() +
              ".mcap") {}
  ~RecordFile() override { std::filesystem::remove(path_); }
  std::string content() const {
    std::ifstream in(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  }
  void put(const std::string& text) const { std::ofstream(path_, std::ios::binary) << text; }

  static void expect_same(const RecordReader::Channel& read, const RecordChannel& written) {
    EXPECT_EQ(read.topic, written.topic);
    EXPECT_EQ(read.message_encoding, written.message_encoding);
    EXPECT_EQ(read.schema->name, written.schema_name);
    EXPECT_EQ(read.schema->encoding, written.schema_encoding);
    EXPECT_EQ(read.schema->text, written.schema_text);
  }

  const RecordChannel objects_{"softhand/v1/objects", "cdr", "softhand::WorldObjects", "omgidl",
                               "struct WorldObjects {};"};
  const RecordChannel plain_{"other", "json", "", "", ""};
  const std::string path_;
};

TEST_F(RecordFile, ReturnsWhatWasWritten) {
  RecordWriter writer(path_);
  const std::uint16_t a = writer.add_channel(objects_);
  const std::uint16_t b = writer.add_channel(plain_);
  writer.write(a, 7, 100, 90, bytes("first"));
  writer.write(b, 1, 200, 0, {});
  writer.write(a, 8, 300, 290, bytes(std::string_view("a\0b", 3)));
  writer.finish();
  writer.finish();
  EXPECT_THROW(writer.write(a, 9, 1, 1, {}), std::runtime_error);

  RecordReader reader(path_);
  RecordedMessage m;
  ASSERT_TRUE(reader.next(m));
  expect_same(reader.channels().at(m.channel), objects_);
  EXPECT_EQ(m.sequence, 7u);
  EXPECT_EQ(m.log_time, 100);
  EXPECT_EQ(m.publish_time, 90);
  EXPECT_EQ(text_of(m.payload), "first");
  ASSERT_TRUE(reader.next(m));
  expect_same(reader.channels().at(m.channel), plain_);
  EXPECT_TRUE(m.payload.empty());
  ASSERT_TRUE(reader.next(m));
  EXPECT_EQ(text_of(m.payload), std::string("a\0b", 3));
  EXPECT_FALSE(reader.next(m));
  EXPECT_FALSE(reader.next(m));
  EXPECT_FALSE(reader.truncated());
}

// The bytes of https://mcap.dev/spec, written out by hand.
TEST_F(RecordFile, WritesMcap) {
  {
    RecordWriter writer(path_);
    const std::uint16_t channel = writer.add_channel({"t", "cdr", "S", "omgidl", "x"});
    writer.write(channel, 2, 3, 4, bytes("d"));
  }
  using namespace std::string_literals;
  const std::string magic = "\x89MCAP0\r\n"s;
  const std::string u64_zero(8, '\0');
  const std::string expected =
      magic + "\x01\x10\0\0\0\0\0\0\0\0\0\0\0\x08\0\0\0softhand"s +                                        // header
      "\x03\x16\0\0\0\0\0\0\0\x01\0\x01\0\0\0S\x06\0\0\0omgidl\x01\0\0\0x"s +                              // schema
      "\x04\x14\0\0\0\0\0\0\0\x01\0\x01\0\x01\0\0\0t\x03\0\0\0cdr\0\0\0\0"s +                              // channel
      "\x05\x17\0\0\0\0\0\0\0\x01\0\x02\0\0\0\x03\0\0\0\0\0\0\0\x04\0\0\0\0\0\0\0\x64"s +                  // message
      "\x0f\x04\0\0\0\0\0\0\0\0\0\0\0"s + "\x02\x14\0\0\0\0\0\0\0"s + u64_zero + u64_zero + "\0\0\0\0"s +  // ends
      magic;
  EXPECT_EQ(content(), expected);
}

TEST_F(RecordFile, ReadsUpToTheLastWholeMessageOfATruncatedFile) {
  std::size_t first_end = 0, second_end = 0;
  {
    RecordWriter writer(path_);
    const std::uint16_t channel = writer.add_channel(objects_);
    writer.write(channel, 1, 1, 1, bytes("one"));
    first_end = std::filesystem::file_size(path_);  // already in the file while the writer is open
    writer.write(channel, 2, 2, 2, bytes("two"));
    second_end = std::filesystem::file_size(path_);
  }
  const std::string whole = content();
  constexpr std::size_t magic = 8, footer = 9 + 20 + 8;
  for (std::size_t cut = magic; cut <= whole.size(); ++cut) {
    put(whole.substr(0, cut));
    RecordReader reader(path_);
    RecordedMessage m;
    int messages = 0;
    while (reader.next(m)) ++messages;
    EXPECT_EQ(messages, cut >= second_end ? 2 : cut >= first_end ? 1 : 0) << cut;
    EXPECT_EQ(reader.truncated(), cut < whole.size() - footer) << cut;
  }
}

// Where others may write, a link would lead to a file of this user.
TEST_F(RecordFile, ANewFileReplacesAndFollowsNothing) {
  const std::string target = path_ + ".target";
  std::filesystem::create_symlink(target, path_);
  EXPECT_THROW(RecordWriter(path_, RecordWriter::Existing::refuse), std::runtime_error);
  EXPECT_FALSE(std::filesystem::exists(target));
  std::filesystem::remove(path_);
  put("kept");
  EXPECT_THROW(RecordWriter(path_, RecordWriter::Existing::refuse), std::runtime_error);
  EXPECT_EQ(content(), "kept");
  std::filesystem::remove(path_);
  EXPECT_NO_THROW(RecordWriter(path_, RecordWriter::Existing::refuse));
}

// A disk may be full when a message is written and have room again when the file is closed.
TEST_F(RecordFile, NothingFollowsATruncatedMessage) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto former = std::signal(SIGXFSZ, SIG_IGN);
  {
    RecordWriter writer(path_);
    const std::uint16_t channel = writer.add_channel(objects_);
    writer.write(channel, 1, 1, 1, bytes("one"));
    rlimit full = before;
    full.rlim_cur = std::filesystem::file_size(path_) + 40;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &full), 0);
    EXPECT_THROW(writer.write(channel, 2, 2, 2, bytes("twotwotwotwo")), std::runtime_error);
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    EXPECT_THROW(writer.write(channel, 3, 3, 3, bytes("three")), std::runtime_error);
  }
  std::signal(SIGXFSZ, former);
  RecordReader reader(path_);
  RecordedMessage m;
  ASSERT_TRUE(reader.next(m));
  EXPECT_EQ(text_of(m.payload), "one");
  EXPECT_FALSE(reader.next(m)) << text_of(m.payload);
  EXPECT_TRUE(reader.truncated());
}

TEST_F(RecordFile, RefusesFilesThatAreNotRecordings) {
  EXPECT_THROW(RecordReader("/does/not/exist"), std::runtime_error);
  EXPECT_THROW(RecordWriter("/does/not/exist"), std::runtime_error);
  put("");
  EXPECT_THROW(RecordReader{path_}, std::runtime_error);
  put("t_s,px,py");
  EXPECT_THROW(RecordReader{path_}, std::runtime_error);
  using namespace std::string_literals;
  const std::string magic = "\x89MCAP0\r\n"s;
  for (const std::string& record : {"\x05\x16\0\0\0\0\0\0\0"s + std::string(22, '\1'),  // message of an unknown channel
                                    "\x05\x01\0\0\0\0\0\0\0\1"s,                        // message without its fields
                                    "\x04\x08\0\0\0\0\0\0\0\1\0\0\0\xff\xff\xff\xff"s,  // topic longer than the record
                                    "\x04\x0c\0\0\0\0\0\0\0\1\0\5\0\0\0\0\0\0\0\0\0"s,  // channel of an unknown schema
                                    "\x06\0\0\0\0\0\0\0\0"s}) {                         // chunk
    put(magic + record);
    RecordReader reader(path_);
    RecordedMessage m;
    EXPECT_THROW(reader.next(m), std::runtime_error);
  }
  put(magic + "\x05\xff\xff\xff\xff\xff\xff\xff\xff"s);  // an impossible length: truncated; nothing is allocated
  RecordReader reader(path_);
  RecordedMessage m;
  EXPECT_FALSE(reader.next(m));
  EXPECT_TRUE(reader.truncated());
}

// A file of 2 MB would have filled 4 GB: each channel had a copy of the text of its schema.
TEST_F(RecordFile, ChannelsShareTheirSchema) {
  constexpr std::size_t kText = 2'000'000;
  constexpr std::uint16_t kChannels = 2000;
  std::string file("\x89MCAP0\r\n", 8);
  const auto append = [&file](auto value) { file.append(reinterpret_cast<const char*>(&value), sizeof value); };
  const auto begin = [&](char opcode, std::uint64_t size) {
    file += opcode;
    append(size);
  };
  begin(3, 2 + 4 + 4 + 4 + kText);
  append(std::uint16_t{1});
  append(std::uint32_t{0});
  append(std::uint32_t{0});
  append(std::uint32_t{kText});
  file.append(kText, 'x');
  for (std::uint16_t id = 1; id <= kChannels; ++id) {
    begin(4, 2 + 2 + 4 + 4 + 4);
    append(id);
    append(std::uint16_t{1});
    append(std::uint32_t{0});
    append(std::uint32_t{0});
    append(std::uint32_t{0});
  }
  put(file);
  const auto allocated = [] {
    const struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
  };
  const std::size_t before = allocated();
  RecordReader reader(path_);
  RecordedMessage m;
  EXPECT_FALSE(reader.next(m));
  EXPECT_EQ(reader.channels().size(), kChannels);
  EXPECT_LT(allocated() - before, 10 * kText);
}

TEST_F(RecordFile, RefusesUnknownChannels) {
  RecordWriter writer(path_);
  EXPECT_THROW(writer.write(0, 0, 0, 0, {}), std::runtime_error);
  EXPECT_THROW(writer.write(1, 0, 0, 0, {}), std::runtime_error);
}

}  // namespace
}  // namespace softhand::runtime_record_test
