// Maps whose keys come from topics. Anybody on the domain can invent hands, modules and objects.

/** Sets an entry as the one used last. Removes and returns those beyond `most`, which were used longest ago. */
export function remember<K, V>(map: Map<K, V>, key: K, value: V, most: number): V[] {
  map.delete(key);
  map.set(key, value);
  const removed: V[] = [];
  for (const [old, each] of map) {
    if (map.size <= most) break;
    removed.push(each);
    map.delete(old);
  }
  return removed;
}
