#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>

#include "bone_wrenchPubSubTypes.h"
#include "bus/topics.hpp"
#include "clockPubSubTypes.h"
#include "contactsPubSubTypes.h"
#include "couplingPubSubTypes.h"
#include "descriptionsPubSubTypes.h"
#include "devicePubSubTypes.h"
#include "head_posePubSubTypes.h"
#include "integration/bus_fill.hpp"
#include "messagePubSubTypes.h"
#include "objectsPubSubTypes.h"
#include "skeletonPubSubTypes.h"
#include "soft_objectsPubSubTypes.h"
#include "statusPubSubTypes.h"
#include "tissuePubSubTypes.h"
#include "tractionPubSubTypes.h"

namespace softhand::bus {
namespace {

namespace rtps = eprosima::fastrtps::rtps;

template <typename T>
struct Named;
#define SOFTHAND_NAMED(T)                   \
  template <>                               \
  struct Named<T> {                         \
    static constexpr const char* name = #T; \
  }
SOFTHAND_NAMED(HandKey);
SOFTHAND_NAMED(Chain);
SOFTHAND_NAMED(Stamp);
SOFTHAND_NAMED(JointSample);
SOFTHAND_NAMED(Skeleton);
SOFTHAND_NAMED(HeadPose);
SOFTHAND_NAMED(TissueSurface);
SOFTHAND_NAMED(Contact);
SOFTHAND_NAMED(FingerContact);
SOFTHAND_NAMED(NearContact);
SOFTHAND_NAMED(Contacts);
SOFTHAND_NAMED(SkinRegion);
SOFTHAND_NAMED(SkinTraction);
SOFTHAND_NAMED(ShapeFile);
SOFTHAND_NAMED(Shape);
SOFTHAND_NAMED(ObjectDescription);
SOFTHAND_NAMED(JointDetent);
SOFTHAND_NAMED(ObjectJointDescription);
SOFTHAND_NAMED(NeighbourPlane);
SOFTHAND_NAMED(ObjectState);
SOFTHAND_NAMED(WorldObjects);
SOFTHAND_NAMED(ObjectTwin);
SOFTHAND_NAMED(ContactPatch);
SOFTHAND_NAMED(ObjectCoupling);
SOFTHAND_NAMED(BoneSample);
SOFTHAND_NAMED(BoneWrench);
SOFTHAND_NAMED(DeviceState);
SOFTHAND_NAMED(Message);
SOFTHAND_NAMED(MessageReply);
SOFTHAND_NAMED(NamedValue);
SOFTHAND_NAMED(LoopStatus);
SOFTHAND_NAMED(RigChoice);
SOFTHAND_NAMED(RigChoices);
SOFTHAND_NAMED(SoftObjectDescription);
SOFTHAND_NAMED(SoftObjectState);
SOFTHAND_NAMED(HostClock);
SOFTHAND_NAMED(ClockBeacon);
SOFTHAND_NAMED(HandDescription);
#undef SOFTHAND_NAMED

/// struct name -> its fields as "[@key ]type name", in order.
using FieldMap = std::map<std::string, std::vector<std::string>>;

struct MapFields {
  FieldMap& map;
  std::string owner;

  template <typename T>
  std::string type_of() {
    if constexpr (std::is_same_v<T, double>)
      return "double";
    else if constexpr (std::is_same_v<T, float>)
      return "float";
    else if constexpr (std::is_same_v<T, std::uint32_t>)
      return "uint32";
    else if constexpr (std::is_same_v<T, std::uint64_t>)
      return "uint64";
    else if constexpr (std::is_same_v<T, std::int64_t>)
      return "int64";
    else if constexpr (std::is_same_v<T, Vec3>)
      return "Vector3";
    else if constexpr (std::is_same_v<T, Vec4>)
      return "Quaternion";
    else if constexpr (std::is_same_v<T, std::array<float, 3>>)
      return "FloatVector3";
    else if constexpr (std::is_same_v<T, std::array<float, 4>>)
      return "FloatVector4";
    else if constexpr (std::is_same_v<T, std::array<std::uint32_t, 3>>)
      return "Indices3";
    else if constexpr (std::is_same_v<T, std::array<std::uint32_t, 4>>)
      return "Indices4";
    else if constexpr (detail::is_text<T>)
      return "string<" + std::to_string(std::tuple_size_v<T> - 1) + ">";
    else if constexpr (detail::is_array<T>)
      return type_of<typename T::value_type>() + "[" + std::to_string(std::tuple_size_v<T>) + "]";
    else if constexpr (detail::is_sequence<T>)
      return "sequence<" + type_of<typename decltype(T::items)::value_type>() + "," + std::to_string(T::max_size()) +
             ">";
    else {
      const std::string name = Named<T>::name;
      if (!map.contains(name)) {
        map[name] = {};
        const auto example = std::make_unique<T>();
        visit_fields(MapFields{map, name}, *example);
      }
      return name;
    }
  }
  template <typename T>
  void key(const char* name, const T&) {
    map[owner].push_back("@key " + type_of<T>() + " " + name);
  }
  template <typename T>
  void field(const char* name, const T&) {
    std::string line = type_of<T>() + " " + name;
    map[owner].push_back(line);
  }
};

FieldMap map_of_messages() {
  FieldMap map;
  topics::for_each([&]<typename T>(const Topic<T>&) { MapFields{map, ""}.template type_of<T>(); });
  return map;
}

FieldMap map_of_idl() {
  FieldMap map;
  std::map<std::string, std::string> constants;
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(SOFTHAND_SOURCE_DIR "/idl"))
    if (entry.path().extension() == ".idl") paths.push_back(entry.path());
  std::vector<std::string> texts;
  for (const auto& path : paths) {
    std::stringstream stream;
    stream << std::ifstream(path).rdbuf();
    texts.push_back(std::regex_replace(std::regex_replace(stream.str(), std::regex(R"(//[^\n]*)"), ""),
                                       std::regex(R"(/\*[\s\S]*?\*/)"), ""));
  }
  const auto each = [](const std::string& text, const std::regex& pattern, auto&& f) {
    for (std::sregex_iterator i(text.begin(), text.end(), pattern), end; i != end; ++i) f(*i);
  };
  for (const std::string& text : texts)
    each(text, std::regex(R"(const uint32 (\w+) = (\d+);)"),
         [&](const std::smatch& m) { constants["softhand::v1::" + m.str(1)] = m.str(2); });
  for (std::string text : texts) {
    for (const auto& [name, value] : constants) text = std::regex_replace(text, std::regex(name + "\\b"), value);
    each(text, std::regex(R"((@final )?struct (\w+) \{([^}]*)\};)"), [&](const std::smatch& m) {
      EXPECT_TRUE(m[1].matched) << m.str(2) << " is not @final";
      auto& fields = map[m.str(2)];
      const std::string body = m.str(3);
      each(body, std::regex(R"((@key )?(sequence<\w+, *\d+>|[\w<>]+) (\w+)(\[\d+\])?;)"), [&](const std::smatch& f) {
        fields.push_back(f.str(1) + std::regex_replace(f.str(2), std::regex(" "), "") + f.str(4) + " " + f.str(3));
      });
      EXPECT_EQ(fields.size(), static_cast<std::size_t>(std::count(body.begin(), body.end(), ';')))
          << m.str(2) << ": a field that this test cannot read";
    });
  }
  return map;
}

TEST(BusWire, FieldsMatchTheIdl) {
  FieldMap idl = map_of_idl();
  const std::map<std::string, std::string> plain{{"Vector3", "double"},     {"Quaternion", "double"},
                                                 {"FloatVector3", "float"}, {"FloatVector4", "float"},
                                                 {"Indices3", "uint32"},    {"Indices4", "uint32"}};
  for (const auto& [name, number] : plain) {
    ASSERT_TRUE(idl.contains(name));
    EXPECT_EQ(idl[name].size(), name == "Quaternion" || name.back() == '4' ? 4u : 3u);
    for (const std::string& field : idl[name]) EXPECT_EQ(field.substr(0, field.find(' ')), number) << name;
    idl.erase(name);
  }
  EXPECT_EQ(idl, map_of_messages());
}

TEST(BusWire, TopicNamesAndTypesAgree) {
  std::set<std::string_view> names;
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    EXPECT_TRUE(names.insert(topic.name).second) << topic.name;
    std::smatch version;
    const std::string name(topic.name);
    ASSERT_TRUE(std::regex_search(name, version, std::regex("^softhand/(v[0-9]+)/")));
    EXPECT_EQ(std::string(topic.type), "softhand::" + version.str(1) + "::" + Named<T>::name);
    EXPECT_EQ(codec_of<T>(topic.type).max_key_size() > 0,
              !(std::is_same_v<T, Message> || std::is_same_v<T, MessageReply> || std::is_same_v<T, ClockBeacon>))
        << topic.name;
  });
  EXPECT_EQ(names.size(), 22u);
}

/// Sends a message through Fast's generated type and back. The bytes, the maximum size and the key must be the same.
template <typename T, typename Generated>
void expect_same_as_generated(const char* name) {
  SCOPED_TRACE(name);
  Generated type;
  EXPECT_TRUE(std::string(type.getName()).ends_with(std::string("::") + Named<T>::name));
  EXPECT_LE(max_encoded_size<T>(), type.m_typeSize);
  void* object = type.createData();
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const bool to_capacity = seed == 4;
    const auto message = filled<T>(seed, to_capacity);
    const auto bytes = bytes_of(*message);
    ASSERT_EQ(bytes.size(), encoded_size(*message));
    if (to_capacity) {
      ASSERT_EQ(bytes.size(), max_encoded_size<T>());
    }
    rtps::SerializedPayload_t in(static_cast<std::uint32_t>(bytes.size()));
    std::memcpy(in.data, bytes.data(), bytes.size());
    in.length = static_cast<std::uint32_t>(bytes.size());
    in.encapsulation = CDR_LE;
    ASSERT_TRUE(type.deserialize(&in, object));
    rtps::SerializedPayload_t out(type.m_typeSize);
    ASSERT_TRUE(type.serialize(object, &out));
    ASSERT_EQ(out.length, bytes.size());
    ASSERT_EQ(std::memcmp(out.data, bytes.data(), bytes.size()), 0);

    const auto again = std::make_unique<T>();
    ASSERT_TRUE(decode(bytes, *again));
    ASSERT_EQ(bytes_of(*again), bytes);

    const auto& codec = codec_of<T>(Named<T>::name);
    ASSERT_EQ(type.m_isGetKeyDefined, codec.max_key_size() > 0);
    if (codec.max_key_size() > 0 && codec.max_key_size() <= 16) {
      std::array<std::byte, 80> key{};
      codec.key(message.get(), key);
      rtps::InstanceHandle_t handle;
      ASSERT_TRUE(type.getKey(object, &handle));
      for (std::size_t i = 0; i < 16; ++i) ASSERT_EQ(static_cast<int>(handle.value[i]), static_cast<int>(key[i])) << i;
    }
  }
  type.deleteData(object);
}

TEST(BusWire, BytesMatchFastsGenerator) {
#define SOFTHAND_CHECK(T) expect_same_as_generated<T, v1::T##PubSubType>(#T)
  SOFTHAND_CHECK(Skeleton);
  SOFTHAND_CHECK(HeadPose);
  SOFTHAND_CHECK(TissueSurface);
  SOFTHAND_CHECK(Contacts);
  SOFTHAND_CHECK(SkinTraction);
  SOFTHAND_CHECK(WorldObjects);
  SOFTHAND_CHECK(ObjectCoupling);
  SOFTHAND_CHECK(BoneWrench);
  SOFTHAND_CHECK(DeviceState);
  SOFTHAND_CHECK(Message);
  SOFTHAND_CHECK(MessageReply);
  SOFTHAND_CHECK(LoopStatus);
  SOFTHAND_CHECK(RigChoices);
  SOFTHAND_CHECK(ObjectDescription);
  SOFTHAND_CHECK(ObjectJointDescription);
  SOFTHAND_CHECK(SoftObjectDescription);
  SOFTHAND_CHECK(SoftObjectState);
  SOFTHAND_CHECK(ClockBeacon);
  SOFTHAND_CHECK(HandDescription);
#undef SOFTHAND_CHECK
}

// A changed struct is a new version of its topic (docs/topics.md). Programs of other makes take their hashes from the
// file.
TEST(BusWire, EveryDefinitionHasTheHashInTheFile) {
  std::string text;
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    char hash[17];
    std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(definition_hash<T>()));
    text += std::string(topic.name) + " " + hash + "\n";
  });
  std::ifstream in(SOFTHAND_SOURCE_DIR "/idl/hashes.txt");
  const std::string committed((std::istreambuf_iterator<char>(in)), {});
  EXPECT_EQ(committed, text) << "a definition has changed: see \"Change a topic\" in docs/topics.md";
}

TEST(BusWire, ADefinitionHasNamesKindsSizesAndBounds) {
  detail::Define define;
  define(HandKey{});
  EXPECT_EQ(define.text, "{@user:uint32;@side:uint32;}");
  define.text.clear();
  define(NamedValue{});
  EXPECT_EQ(define.text, "{name:string<31>;value:float64;}");
  define.text.clear();
  define(BoundedVector<std::array<float, 3>, 5>{});
  EXPECT_EQ(define.text, "float32[3]<5>");
}

TEST(BusWire, TruncatedLongAndForeignBytesAreRefused) {
  const auto message = filled<LoopStatus>(7);
  const auto bytes = bytes_of(*message);
  LoopStatus out;
  for (std::size_t size = 0; size < bytes.size(); ++size)
    ASSERT_FALSE(decode(std::span(bytes).first(size), out)) << size;
  auto padded = bytes;
  padded.resize(bytes.size() + 3);
  EXPECT_TRUE(decode(padded, out));
  padded.resize(bytes.size() + 4);
  EXPECT_FALSE(decode(padded, out));
  auto big_endian = bytes;
  big_endian[1] = std::byte{0};
  EXPECT_FALSE(decode(big_endian, out));
  auto xcdr2 = bytes;
  xcdr2[1] = std::byte{7};
  EXPECT_FALSE(decode(xcdr2, out));
}

TEST(BusWire, SequencesAndTextsBeyondTheirBoundsAreRefused) {
  DeviceState state;
  for (std::size_t i = 0; i < kMaxActuators; ++i) state.commands.push_back(1);
  auto bytes = bytes_of(state);
  const std::size_t count_at = bytes.size() - 8 * kMaxActuators - 4 - (bytes.size() - 8 * kMaxActuators - 4) % 4;
  std::size_t at = 0;
  for (std::size_t i = 4; i <= count_at; i += 4) {
    std::uint32_t word = 0;
    std::memcpy(&word, bytes.data() + i, 4);
    if (word == kMaxActuators) at = i;
  }
  ASSERT_GT(at, 0u);
  DeviceState out;
  ASSERT_TRUE(decode(bytes, out));
  const std::uint32_t too_many = kMaxActuators + 1;
  bytes.resize(bytes.size() + 8);
  std::memcpy(bytes.data() + at, &too_many, 4);
  EXPECT_FALSE(decode(bytes, out));
  const std::uint32_t huge = std::numeric_limits<std::uint32_t>::max();
  std::memcpy(bytes.data() + at, &huge, 4);
  EXPECT_FALSE(decode(bytes, out));

  state.commands.count = kMaxActuators + 1;
  std::vector<std::byte> buffer(4096);
  EXPECT_EQ(encode(state, buffer), 0u);

  // A bad count never leads outside the message, although its elements have variable sizes.
  const auto world = std::make_unique<WorldObjects>();
  world->objects.count = huge;
  EXPECT_LE(encoded_size(*world), max_encoded_size<WorldObjects>());
  EXPECT_EQ(encode(*world, buffer), 0u);

  Message message;
  message.value.fill('x');  // no terminating zero: it replaces the last character
  const auto cut = bytes_of(message);
  Message back;
  ASSERT_TRUE(decode(cut, back));
  EXPECT_EQ(std::string(back.value.data()), std::string(63, 'x'));
}

TEST(BusWire, DecodingLeavesNothingOfAnOlderMessage) {
  const auto many = filled<ObjectCoupling>(3, true);
  ObjectCoupling few;
  few.twins.push_back({});
  few.twins[0].object = 9;
  ObjectCoupling out;
  ASSERT_TRUE(decode(bytes_of(*many), out));
  ASSERT_TRUE(decode(bytes_of(few), out));
  ASSERT_EQ(out.twins.size(), 1u);
  for (std::size_t i = 1; i < kMaxMirrored; ++i) {
    EXPECT_EQ(out.twins.items[i].object, 0u);
    EXPECT_EQ(out.twins.items[i].orientation, (Vec4{0, 0, 0, 1}));
  }
}

}  // namespace
}  // namespace softhand::bus
