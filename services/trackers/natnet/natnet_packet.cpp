#include "trackers/natnet/natnet_packet.hpp"

#include <bit>

#include "device/packet_bytes.hpp"

namespace softhand {
namespace {

using Reader = PacketReader<std::endian::little>;

constexpr std::size_t kNameSize = 256;
constexpr std::size_t kVector = 12, kLabelledMarker = 26;  // bytes
constexpr std::uint64_t kFastestTicks = 10'000'000'000;

Vector3 read_vector(Reader& in) {
  Vector3 out;
  for (double& value : out) value = static_cast<double>(in.read<float>());
  return out;
}

// The head of a section. `take` reads its items. From 4.1 on, the section states its size.
template <typename Take>
std::size_t read_section(Reader& in, NatNetVersion version, Take&& take) {
  const std::size_t count = in.read_count();
  if (version < NatNetVersion{4, 1}) {
    for (std::size_t i = 0; i < count && in.good(); ++i) take(in);
    return count;
  }
  Reader items(in.take(in.read_count()));
  for (std::size_t i = 0; i < count && items.good(); ++i) take(items);
  if (!items.at_end()) in.take(static_cast<std::size_t>(-1));  // the items are not as long as their section
  return count;
}

void skip_channels(Reader& in) {
  in.read<std::int32_t>();
  const std::size_t channels = in.read_count();
  for (std::size_t i = 0; i < channels && in.good(); ++i) in.take(sizeof(float), in.read_count());
}

void skip_texts(Reader& in, std::size_t count) {
  for (std::size_t i = 0; i < count && in.good(); ++i) in.take_text();
}

NatNetBone read_body_definition(Reader& in, NatNetVersion version) {
  NatNetBone bone;
  bone.name = in.take_text();
  bone.id = in.read<std::int32_t>();
  bone.parent = in.read<std::int32_t>();
  in.take(kVector);  // from the parent
  const std::size_t markers = in.read_count();
  in.take(kVector + sizeof(std::int32_t), markers);
  if (version >= NatNetVersion{4, 0}) skip_texts(in, markers);
  return bone;
}

using TakeBone = std::function<void(const NatNetBone&)>;

// `take` is null while the payload is only checked.
void read_model(Reader& in, std::int32_t type, NatNetVersion version, const TakeBone* take) {
  switch (type) {
    case 0:  // marker set
      in.take_text();
      skip_texts(in, in.read_count());
      break;
    case 1:
      read_body_definition(in, version);
      break;
    case 2: {
      const std::string_view skeleton = in.take_text();
      const auto id = in.read<std::int32_t>();
      const std::size_t bones = in.read_count();
      for (std::size_t i = 0; i < bones && in.good(); ++i) {
        NatNetBone bone = read_body_definition(in, version);
        bone.skeleton = skeleton;
        bone.skeleton_id = id;
        if (take != nullptr) (*take)(bone);
      }
      break;
    }
    case 3:                          // force plate
      in.take(4);                    // id
      in.take_text();                // serial number
      in.take(4, 2 + 3 + 144 + 12);  // size, origin, calibration, corners
      in.take(4, 2);                 // kinds of the plate and of its channels
      skip_texts(in, in.read_count());
      break;
    case 4:  // device
      in.take(4);
      skip_texts(in, 2);
      in.take(4, 2);
      skip_texts(in, in.read_count());
      break;
    case 5:  // camera
      in.take_text();
      in.take(4, 7);
      break;
    default:
      in.take(static_cast<std::size_t>(-1));
  }
}

bool read_models(std::string_view payload, NatNetVersion version, const TakeBone* take) {
  Reader in(payload);
  const std::size_t models = in.read_count();
  for (std::size_t i = 0; i < models && in.good(); ++i) {
    const auto type = in.read<std::int32_t>();
    if (version < NatNetVersion{4, 1}) {
      read_model(in, type, version, take);
      continue;
    }
    // A model that states its size may be of a kind that is not known.
    Reader model(in.take(in.read_count()));
    if (type < 0 || type > 5) continue;
    read_model(model, type, version, take);
    if (!model.at_end()) return false;
  }
  return in.at_end();
}

}  // namespace

std::optional<NatNetPacket> read_natnet(std::string_view packet) {
  Reader in(packet);
  const auto message = in.read<std::uint16_t>();
  const std::string_view payload = in.take(in.read<std::uint16_t>());
  if (!in.at_end()) return std::nullopt;
  return NatNetPacket{static_cast<NatNetMessage>(message), payload};
}

std::optional<NatNetServer> read_server_info(std::string_view payload) {
  Reader in(payload);
  NatNetServer out;
  in.take(kNameSize + 4);  // name, and the version of the program
  out.version.major = in.read<std::uint8_t>();
  out.version.minor = in.read<std::uint8_t>();
  in.take(2);
  out.ticks_per_second = in.read<std::uint64_t>();
  in.take(2 + 1 + 4);  // how it sends: the options say this
  if (!in.at_end() || out.ticks_per_second == 0 || out.ticks_per_second > kFastestTicks) return std::nullopt;
  return out;
}

NatNetBody NatNetBodies::operator[](std::size_t i) const {
  Reader in(bytes_.substr(i * kSize, kSize));
  NatNetBody body;
  body.id = in.read<std::int32_t>();
  body.pose.position = read_vector(in);
  for (double& value : body.pose.orientation.coeffs()) value = static_cast<double>(in.read<float>());
  in.read<float>();  // mean error of the markers
  body.is_tracked = (in.read<std::uint16_t>() & 1) != 0;
  return body;
}

std::optional<NatNetFrame> read_frame(std::string_view payload, NatNetVersion version) {
  Reader in(payload);
  NatNetFrame frame;
  const bool has_precise_time = version >= NatNetVersion{4, 1}, has_assets = has_precise_time;
  frame.number = in.read<std::int32_t>();
  frame.marker_sets = read_section(in, version, [](Reader& items) {
    items.take_text();
    items.take(kVector, items.read_count());
  });
  frame.other_markers = read_section(in, version, [](Reader& items) { items.take(kVector); });
  const char* first = nullptr;
  const std::size_t bodies = read_section(in, version, [&](Reader& items) {
    const std::string_view body = items.take(NatNetBodies::kSize);
    if (first == nullptr) first = body.data();
  });
  if (in.good() && bodies > 0) frame.bodies = NatNetBodies({first, bodies * NatNetBodies::kSize});
  first = nullptr;
  const char* end = nullptr;
  frame.skeleton_count = read_section(in, version, [&](Reader& items) {
    const std::string_view id = items.take(4);
    if (first == nullptr) first = id.data();
    const std::string_view bones = items.take(NatNetBodies::kSize, items.read_count());
    end = bones.data() + bones.size();
  });
  if (in.good() && frame.skeleton_count > 0) frame.skeletons = {first, static_cast<std::size_t>(end - first)};
  if (has_assets) {
    frame.assets = read_section(in, version, [](Reader& items) {
      items.read<std::int32_t>();
      items.take(NatNetBodies::kSize, items.read_count());
      items.take(kLabelledMarker, items.read_count());
    });
  }
  frame.labelled_markers = read_section(in, version, [](Reader& items) { items.take(kLabelledMarker); });
  frame.force_plates = read_section(in, version, skip_channels);
  frame.devices = read_section(in, version, skip_channels);
  in.take(8);  // time code
  frame.time = in.read<double>();
  frame.exposure = in.read<std::uint64_t>();
  frame.received = in.read<std::uint64_t>();
  frame.transmit = in.read<std::uint64_t>();
  if (has_precise_time) in.take(8);
  frame.parameters = in.read<std::uint16_t>();
  const auto last = in.read<std::int32_t>();
  if (!in.at_end() || last != 0) return std::nullopt;
  return frame;
}

NatNetBodies NatNetFrame::skeleton(std::int32_t id) const {
  Reader in(skeletons);
  for (std::size_t i = 0; i < skeleton_count; ++i) {
    const auto each = in.read<std::int32_t>();
    const std::string_view bones = in.take(NatNetBodies::kSize, in.read_count());
    if (each == id) return NatNetBodies(bones);
  }
  return NatNetBodies();
}

bool read_models(std::string_view payload, NatNetVersion version, const TakeBone& take) {
  return read_models(payload, version, nullptr) && read_models(payload, version, &take);
}

}  // namespace softhand
