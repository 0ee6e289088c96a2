// SPDX-License-Identifier: Apache-2.0
#include "data/import/mesh_bridge.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <assimp/BaseImporter.h>
#include <assimp/GltfMaterial.h>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <assimp/config.h>
#include <assimp/importerdesc.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include "data/import/exception.h"

namespace {

// A file in memory.
class Stream : public Assimp::IOStream {
  public:
    explicit Stream(const mesh_bytes &bytes) : bytes_(bytes) {
    }
    size_t Read(void *to, size_t item, size_t count) override {
        if (item == 0)
            return 0;
        count = std::min(count, (bytes_.size - at_) / item);
        memcpy(to, bytes_.start + at_, item * count);
        at_ += item * count;
        return count;
    }
    size_t Write(const void *, size_t, size_t) override {
        return 0;
    }
    aiReturn Seek(size_t offset, aiOrigin origin) override {
        const size_t base = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? at_ : bytes_.size;
        // An offset from the end is subtracted, as by assimp's own streams in memory.
        if (origin == aiOrigin_END ? offset > base : offset > bytes_.size - base)
            return aiReturn_FAILURE;
        at_ = origin == aiOrigin_END ? base - offset : base + offset;
        return aiReturn_SUCCESS;
    }
    size_t Tell() const override {
        return at_;
    }
    size_t FileSize() const override {
        return bytes_.size;
    }
    void Flush() override {
    }

  private:
    const mesh_bytes bytes_;
    size_t at_ = 0;
};

// The file itself, and the files that mesh.c finds for it.
class Files : public Assimp::IOSystem {
  public:
    Files(const mesh_bytes &own, std::string name, mesh_bridge_find *find, void *user)
        : own_(own), name_(std::move(name)), find_(find), user_(user) {
    }
    bool Exists(const char *name) const override {
        mesh_bytes bytes;
        return get(name, &bytes);
    }
    char getOsSeparator() const override {
        return '/';
    }
    Assimp::IOStream *Open(const char *name, const char *mode) override {
        mesh_bytes bytes;
        if (strchr(mode, 'w') || strchr(mode, 'a') || !get(name, &bytes))
            return nullptr;
        return new Stream(bytes);
    }
    void Close(Assimp::IOStream *stream) override {
        delete stream;
    }

  private:
    bool get(const char *name, mesh_bytes *bytes) const {
        while (strncmp(name, "./", 2) == 0)
            name += 2;
        if (name_ == name)
            *bytes = own_;
        return name_ == name || find_(user_, name, bytes);
    }
    const mesh_bytes own_;
    const std::string name_;
    mesh_bridge_find *const find_;
    void *const user_;
};

} // namespace

struct mesh_bridge {
    Assimp::Importer importer;
    const aiScene *scene = nullptr;
    bool is_linear = false; // colours
};

// assimp makes a text of each exception, so only this handler learns that an allocation failed.
// After that, every error of the same file counts as a lack of memory.
static bool is_exhausted;

static void note_exhaustion() {
    is_exhausted = true;
    throw std::bad_alloc();
}

static bool explain(sp_error *err, const char *text) {
    if (is_exhausted)
        return import_fail_memory(err);
    sp_fail(err, SP_ERR_FORMAT, "", "%s", text ? text : "");
    for (char *c = err->text; *c; c++)
        if (static_cast<unsigned char>(*c) < 0x20)
            *c = ' ';
    return false;
}

// Leaves one reader: no other one looks at the file. There are two of glTF; the last one reads
// version 2.
static void choose_reader(Assimp::Importer &importer, const char *extension) {
    bool is_found = false;
    for (size_t i = importer.GetImporterCount(); i-- > 0;) {
        std::istringstream known(importer.GetImporterInfo(i)->mFileExtensions);
        const std::istream_iterator<std::string> begin(known), end;
        if (!is_found && std::find(begin, end, extension) != end)
            is_found = true;
        else if (Assimp::BaseImporter *other = importer.GetImporter(i)) {
            importer.UnregisterLoader(other); // which leaves it to the caller
            delete other;
        }
    }
}

static mesh_bridge *open_mesh(const mesh_bytes *bytes, const char *extension,
                              mesh_bridge_find *find, void *user, sp_error *err) try {
    is_exhausted = false;
    std::set_new_handler(note_exhaustion);
    auto bridge = std::make_unique<mesh_bridge>();
    Assimp::Importer &importer = bridge->importer;
    const bool is_stl = strcmp(extension, "stl") == 0;
    const std::string name = std::string("mesh.") + extension;
    int removed = aiComponent_TANGENTS_AND_BITANGENTS | aiComponent_BONEWEIGHTS |
                  aiComponent_ANIMATIONS | aiComponent_TEXTURES | aiComponent_LIGHTS |
                  aiComponent_CAMERAS | aiComponent_TEXCOORDS;
    if (is_stl) // one normal per triangle, from which nothing can be learned
        removed |= aiComponent_NORMALS;
    bridge->is_linear = strcmp(extension, "gltf") == 0 || strcmp(extension, "glb") == 0;
    choose_reader(importer, extension);
    importer.SetIOHandler(new Files(*bytes, name, find, user));
    // A solid without a facet is valid, but not to assimp. The other steps check what they read.
    const unsigned validate = is_stl ? 0 : unsigned{ aiProcess_ValidateDataStructure };
    importer.SetPropertyInteger(AI_CONFIG_PP_RVC_FLAGS, removed);
    importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT);
    bridge->scene =
        importer.ReadFile(name, validate | aiProcess_RemoveComponent | aiProcess_Triangulate |
                                    aiProcess_PreTransformVertices | aiProcess_SortByPType);
    if (!bridge->scene) {
        explain(err, importer.GetErrorString());
        return nullptr;
    }
    return bridge.release();
} catch (const std::exception &e) {
    explain(err, e.what());
    return nullptr;
}

static void close_mesh(mesh_bridge *bridge) {
    delete bridge;
}

// The colour of a mesh whose file gives none.
static const aiColor4D plain(0.8f, 0.8f, 0.8f, 1);

// Returns false if the file gives no colour.
static bool material_color(const mesh_bridge *bridge, const aiMesh *mesh, aiColor4D &color) {
    aiString name, mode;
    float opacity = 1;
    color = plain;
    if (mesh->mMaterialIndex >= bridge->scene->mNumMaterials)
        return false;
    const aiMaterial *material = bridge->scene->mMaterials[mesh->mMaterialIndex];
    if (material->Get(AI_MATKEY_NAME, name) == aiReturn_SUCCESS &&
        strcmp(name.C_Str(), AI_DEFAULT_MATERIAL_NAME) == 0)
        return false;
    bool is_found = material->Get(AI_MATKEY_BASE_COLOR, color) == aiReturn_SUCCESS;
    if (!is_found) {
        is_found = material->Get(AI_MATKEY_COLOR_DIFFUSE, color) == aiReturn_SUCCESS;
        if (is_found && material->Get(AI_MATKEY_OPACITY, opacity) == aiReturn_SUCCESS)
            color.a = opacity;
    }
    if (material->Get(AI_MATKEY_GLTF_ALPHAMODE, mode) == aiReturn_SUCCESS &&
        strcmp(mode.C_Str(), "OPAQUE") == 0)
        color.a = 1;
    return is_found;
}

static_assert(sizeof(aiVector3D) == 3 * sizeof(float) && sizeof(aiColor4D) == 4 * sizeof(float),
              "arrays of assimp are arrays of float");

static bool describe_part(const mesh_bridge *bridge, unsigned n, mesh_bridge_part *part) {
    *part = {};
    if (n >= bridge->scene->mNumMeshes)
        return false;
    const aiMesh *mesh = bridge->scene->mMeshes[n];
    aiColor4D color;
    const bool has_material = material_color(bridge, mesh, color);
    part->vertices = mesh->mNumVertices;
    part->positions = reinterpret_cast<const float(*)[3]>(mesh->mVertices);
    if (mesh->HasNormals())
        part->normals = reinterpret_cast<const float(*)[3]>(mesh->mNormals);
    if (mesh->HasVertexColors(0))
        part->colors = reinterpret_cast<const float(*)[4]>(mesh->mColors[0]);
    for (unsigned i = 0; i < 4; i++) // only glTF multiplies both
        part->color[i] = part->colors && !bridge->is_linear ? 1 : color[i];
    part->has_colors = part->colors || has_material;
    part->is_linear = bridge->is_linear;
    for (unsigned i = 0; i < mesh->mNumFaces; i++)
        part->triangles += mesh->mFaces[i].mNumIndices == 3;
    return true;
}

static bool has_vertices(const aiMesh *mesh, const aiFace &face, unsigned count) {
    bool ok = face.mNumIndices == count;
    for (unsigned k = 0; ok && k < count; k++)
        ok = face.mIndices[k] < mesh->mNumVertices;
    return ok;
}

static bool walk_triangles(const mesh_bridge *bridge, unsigned n,
                           bool (*add)(void *user, const uint32_t vertices[3]), void *user) {
    const aiMesh *mesh = bridge->scene->mMeshes[n];
    for (unsigned i = 0; i < mesh->mNumFaces; i++) {
        const aiFace &face = mesh->mFaces[i];
        if (has_vertices(mesh, face, 3) && !add(user, face.mIndices))
            return false;
    }
    return true;
}

// Segments of which one starts where the last one ends are one line: OBJ gives each its own
// vertices.
static bool walk_lines(const mesh_bridge *bridge, unsigned n,
                       bool (*add)(void *user, uint32_t vertex, bool begins), void *user) {
    const aiMesh *mesh = bridge->scene->mMeshes[n];
    const aiVector3D *last = nullptr;
    for (unsigned i = 0; i < mesh->mNumFaces; i++) {
        const aiFace &face = mesh->mFaces[i];
        if (!has_vertices(mesh, face, 2))
            continue;
        if (!(last && *last == mesh->mVertices[face.mIndices[0]]) &&
            !add(user, face.mIndices[0], true))
            return false;
        if (!add(user, face.mIndices[1], false))
            return false;
        last = &mesh->mVertices[face.mIndices[1]];
    }
    return true;
}

extern "C" __attribute__((visibility("default")))
const mesh_bridge_functions splat_mesh_bridge = { open_mesh, close_mesh, describe_part,
                                                  walk_triangles, walk_lines };
