#include "mesh/gltf/draco_mesh.h"

#include <draco/compression/decode.h>
#include <draco/mesh/mesh.h>

#include <exception>

#include "mesh/mesh_stream.h"

namespace mesh::gltf {
namespace {

std::uint64_t componentTypeOf(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8:
      return kByte;
    case draco::DT_UINT8:
      return kUnsignedByte;
    case draco::DT_INT16:
      return kShort;
    case draco::DT_UINT16:
      return kUnsignedShort;
    case draco::DT_UINT32:
      return kUnsignedInt;
    case draco::DT_FLOAT32:
      return kFloat;
    default:
      return 0;
  }
}

Accessor accessorOf(base::Bytes bytes, std::uint64_t component_type, std::size_t components) {
  Accessor accessor;
  accessor.component_type = component_type;
  accessor.components = components;
  accessor.stride = accessor.elementBytes();
  accessor.count = bytes.size() / accessor.stride;
  const auto owner = std::make_shared<const base::Bytes>(std::move(bytes));
  accessor.data = owner->data();
  accessor.owner = owner;
  return accessor;
}

}  // namespace

base::Result<DracoMesh> DracoMesh::decode(base::ByteView compressed, const std::string& place) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(compressed.data()), compressed.size());
  draco::Decoder decoder;
  // The decoder makes room for as many points as the bytes claim, which may be more than any machine has.
  try {
    auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
    if (!decoded.ok())
      return invalidInput(place + " is compressed by Draco and broken: " + inQuotes(decoded.status().error_msg()));
    std::shared_ptr<const draco::Mesh> mesh = std::move(decoded).value();
    for (draco::FaceIndex f(0); f < mesh->num_faces(); ++f)
      for (const draco::PointIndex& corner : mesh->face(f))
        if (corner.value() >= mesh->num_points()) return indexOutOfRange(place, corner.value(), mesh->num_points());
    return DracoMesh(std::move(mesh));
  } catch (const std::exception&) {
    return invalidInput(place + " is compressed by Draco and claims more than fits into memory (broken?)");
  }
}

std::uint64_t DracoMesh::points() const {
  return mesh_->num_points();
}

Accessor DracoMesh::indices() const {
  base::Bytes bytes(std::size_t{mesh_->num_faces()} * 3 * sizeof(std::uint32_t));
  std::uint8_t* to = bytes.data();
  for (draco::FaceIndex f(0); f < mesh_->num_faces(); ++f)
    for (const draco::PointIndex& corner : mesh_->face(f)) {
      const std::uint32_t index = corner.value();
      std::memcpy(to, &index, sizeof(index));
      to += sizeof(index);
    }
  return accessorOf(std::move(bytes), kUnsignedInt, 1);
}

base::Result<Accessor> DracoMesh::attribute(std::uint64_t number, const std::string& here) const {
  const draco::PointAttribute* attribute =
      number <= 0xFFFFFFFFU ? mesh_->GetAttributeByUniqueId(static_cast<std::uint32_t>(number)) : nullptr;
  if (attribute == nullptr) return invalidInput(here + " is not among the attributes that are compressed by Draco");
  const std::uint64_t type = componentTypeOf(attribute->data_type());
  const std::size_t components = attribute->num_components();
  const std::size_t element = componentBytes(type) * components;
  const auto stride = static_cast<std::size_t>(attribute->byte_stride());
  if (element == 0 || stride < element)
    return unsupported(here + " is compressed by Draco with a type that is not read");
  const draco::DataBuffer* values = attribute->buffer();
  if (values == nullptr || values->data_size() / stride < attribute->size())
    return invalidInput(here + " is compressed by Draco and broken");

  base::Bytes bytes(static_cast<std::size_t>(points()) * element);
  for (std::uint32_t p = 0; p < mesh_->num_points(); ++p) {
    const std::uint32_t value = attribute->mapped_index(draco::PointIndex(p)).value();
    if (value >= attribute->size()) return invalidInput(here + " is compressed by Draco and broken");
    std::memcpy(bytes.data() + p * element, values->data() + value * stride, element);
  }
  return accessorOf(std::move(bytes), type, components);
}

}  // namespace mesh::gltf
