import sys, json, numpy as np
from mcap.reader import make_reader
d=sys.argv[1]
rows=[]
with open(d+'/drones/drone1/flight.mcap','rb') as f:
    for schema, ch, msg in make_reader(f).iter_messages():
        if ch.message_encoding=='json':
            r=json.loads(msg.data); rows.append((ch.topic,r))
topics={}
for t,r in rows: topics.setdefault(t,r)
for t,r in topics.items(): print(t, str(r)[:600])
