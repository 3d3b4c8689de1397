// Mesh files. The first byte chooses OBJ, STL, GLB or glTF.
#include "fuzz/fuzzer.hpp"
#include "mesh_files/mesh_file.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0 || data[0] >= kMeshSuffixes.size()) return 0;
  const ScratchFile file(data + 1, size - 1, kMeshSuffixes[data[0]]);
  accepts([&] {
    const TriangleMesh mesh = load_mesh(file.path());
    for (const auto& triangle : mesh.triangles) {
      for (const std::int32_t vertex : triangle)
        expect(vertex >= 0 && static_cast<std::size_t>(vertex) < mesh.vertices.size(), "a triangle has its vertices");
    }
    for (const Vector3& vertex : mesh.vertices) expect(vertex.allFinite(), "vertices are finite");
  });
  return 0;
}

}  // namespace softhand::fuzz
