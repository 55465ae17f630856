"""temporary"""
from __future__ import annotations


class Gallery:
    def look(self, d, p): pass
def write(*a): return []
def as_text(made):
    out=[]
    for s in made:
        out.append(s.title)
        for t in (s.table,*s.breakdowns):
            out.append(t.title+'  '+' | '.join(c.heading for c in t.columns))
            for l,r in zip(t.labels,t.rows):
                out.append(f'{l:26s}'+'  '.join(c.text(x.value)+('*' if x.best else '~' if x.as_good else ' ') for c,x in zip(t.columns,r)))
        out+=s.notes
    return '\n'.join(out)
