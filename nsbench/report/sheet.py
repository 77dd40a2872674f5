"""The page's style sheet and its few lines of script; nothing is fetched, and without the script
nothing is lost."""

from nsbench.report.style import DARK, MUTED, PALETTE, PAPER, RULE, SHADE

_LIGHT = "".join(f"--m{i}:{c};" for i, c in enumerate(PALETTE))
_NIGHT = "".join(f"--m{i}:{c};" for i, c in enumerate(DARK))
_ROOT = f"""
:root{{color-scheme:light dark;--paper:{PAPER};--ink:#1c1b1a;--muted:{MUTED};--rule:{RULE};--shade:{SHADE};
--flag:#8a4b00;--flagbg:#fdf0d9;--bad:#a3241b;--badbg:#fbe9e6;--link:#0b5c91;{_LIGHT}
--text:"Iowan Old Style","Palatino Linotype",Palatino,"URW Palladio L","P052",Georgia,serif;
--sans:system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",sans-serif;
--mono:ui-monospace,"SF Mono",Menlo,Consolas,"DejaVu Sans Mono",monospace}}
@media (prefers-color-scheme:dark){{:root{{--paper:#16171a;--ink:#e6e3dc;--muted:#9a968d;--rule:#34353a;--shade:#222429;
--flag:#f3c77c;--flagbg:#3a2d14;--bad:#ff9d92;--badbg:#3c1f1c;--link:#7cc0ee;{_NIGHT}}}}}
"""

CSS = (
    _ROOT
    + """
*{box-sizing:border-box}
html{scroll-behavior:smooth;scroll-padding-top:1rem;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--paper);color:var(--ink);font:17px/1.55 var(--text);overflow-wrap:anywhere}
a{color:var(--link);text-decoration:none}a:hover{text-decoration:underline}
main{max-width:1180px;margin:0 auto;padding:0 28px 6rem}
header{padding:3.2rem 0 1.2rem}
h1{font-size:2.1rem;line-height:1.15;font-weight:600;letter-spacing:-.01em;margin:0 0 .5rem}
h2{font-size:1.45rem;font-weight:600;margin:2.8rem 0 .9rem;padding-top:1rem;border-top:1px solid var(--rule)}
h3{font-size:1.12rem;font-weight:600;margin:0}
p{margin:.5rem 0;max-width:68ch}
.lede,.note,.meta{color:var(--muted)}
p.note{font-size:.86rem;margin:.7rem 0;max-width:92ch}.n{white-space:nowrap}
nav{font:13px/1.9 var(--sans);border-top:1px solid var(--rule);padding-top:.8rem}
nav a{margin-right:1.1em;white-space:nowrap}
nav details{margin-top:.2rem}nav details a{white-space:normal;display:inline-block}
summary{cursor:pointer;color:var(--muted)}
code,pre,.m{font-family:var(--mono);font-size:.84em}
pre{margin:.6rem 0;white-space:pre-wrap;color:var(--ink);line-height:1.5}
#verdict h2{border-top:0;margin-top:.2rem}
.say{display:grid;grid-template-columns:11.5rem minmax(0,1fr);gap:0 2rem}
.say>h3{padding:.85rem 0;border-top:1px solid var(--rule);font-size:1rem;line-height:1.35}
.say>ul{margin:0;padding:.8rem 0;border-top:1px solid var(--rule);list-style:none}
section>ul{margin:.6rem 0 0;padding:0;list-style:none}section>h3{margin-top:1.8rem}
.list td.method{width:15em}
.say li{padding:.12rem 0;max-width:84ch}.m{white-space:nowrap}
.say .bad,.bad h3{color:var(--bad)}
.wrap{overflow-x:auto;margin:1rem -8px 0;padding:0 8px}
table{border-collapse:separate;border-spacing:0}
table{font:13.5px/1.35 var(--sans);font-variant-numeric:tabular-nums lining-nums;width:100%}
th{font-weight:500;text-align:left;color:var(--muted);font-size:12px;vertical-align:bottom}
thead th{padding:.3rem .9rem .45rem 0;border-bottom:1.5px solid var(--ink);white-space:nowrap}
td,tbody th{padding:.38rem .9rem .38rem 0;border-bottom:1px solid var(--rule);vertical-align:top}
td{min-width:5.2em}
td small{display:block;color:var(--muted);font-size:11px;line-height:1.3;margin-top:1px}
tr.group th{padding:1.25rem 0 .3rem;color:var(--ink);font:600 15px/1.3 var(--text);border-bottom:1px solid var(--muted)}
td.method{font-family:var(--mono);font-size:12.5px;min-width:9.5em}td.method small{font-family:var(--sans)}
td.best{font-family:var(--mono);font-size:12.5px}td.best small{font-family:var(--sans)}
td.quiet{color:var(--muted)}
td.refused{color:var(--muted);font-style:italic}
td.failed{color:var(--bad)}
td.flag,td.bad{white-space:normal}td.flag b{color:var(--flag);background:var(--flagbg)}
td.bad b{color:var(--bad);background:var(--badbg)}
td b{font-weight:500;border-radius:3px;padding:1px 4px;margin-left:-4px}
.text td:last-child,.text td:nth-child(4){font-family:var(--text);font-size:14.5px}
.tools{font:13px/1.4 var(--sans);color:var(--muted);display:none;gap:1.4rem;flex-wrap:wrap;align-items:center}
.tools{margin-top:1rem}
.js .tools{display:flex}
.tools input[type=search]{font:inherit;color:var(--ink);background:transparent;border:1px solid var(--rule)}
.tools input[type=search]{border-radius:4px;padding:.3rem .6rem;width:17rem;max-width:100%}
.chip{width:9px;height:9px;margin-right:.5em;vertical-align:baseline;overflow:visible}.key{width:21px}
.case{margin-top:3rem;padding-top:1.4rem;border-top:1px solid var(--rule)}
.case:first-of-type{border-top:0;padding-top:0;margin-top:.6rem}
.about{display:flex;gap:2rem;align-items:flex-start;margin-top:.7rem}
.about>div{flex:1;min-width:0}.about p:first-child{margin-top:0}
.scene{width:280px;max-width:100%;flex:none;border-radius:4px;background:#fff}
.about.wide{display:block}.wide .scene{width:100%;max-width:840px;margin-bottom:.6rem}.broad .scene{width:420px}
.meta{font:13px/1.5 var(--sans);margin:.25rem 0 0;max-width:none}
.legend{display:flex;flex-wrap:wrap;gap:.25rem 1.3rem;font:12.5px/1.6 var(--mono);list-style:none}
.legend{margin:1.1rem 0 .2rem;padding:0}
.legend li{cursor:default}
.panels{display:grid;grid-template-columns:repeat(auto-fill,minmax(290px,1fr));gap:.6rem 1.4rem}
.panels text{font-family:var(--sans)}.case>ul{margin:.6rem 0 0;padding:0;list-style:none}.case>ul.legend{margin-top:1.1rem}
.panels svg,.talk svg{display:block;width:100%;height:auto;overflow:visible}
svg *{stroke-linejoin:round;stroke-linecap:butt}
.s{transition:opacity .12s}
.dim .s{opacity:.13}.dim .s.on{opacity:1}
.fits{font-size:.86rem;margin:.8rem 0 0}.fits summary{font:13px/1.5 var(--sans)}
.fits ul{margin:.4rem 0 0;padding:0;list-style:none}.fits li{padding:.12rem 0;max-width:100ch}
.talk{max-width:960px;margin-top:1rem}
@media (max-width:720px){
body{font-size:16px}main{padding:0 16px 4rem}header{padding-top:1.8rem}h1{font-size:1.65rem}
.say{display:block}.say>h3{padding-bottom:0}.say>ul{border-top:0;padding-top:.3rem}
.about{display:block}.scene{width:100%;margin-bottom:.8rem}
.wrap{margin:1rem -16px 0 0;padding:0}
table:not(.list){width:max-content;min-width:100%}
td:first-child.method,thead th:first-child{position:sticky;left:0;background:var(--paper);z-index:1}
td.method{min-width:8em;max-width:12em}td{max-width:13em}
td[colspan]{max-width:none}td[colspan]>div{width:52vw}
table.list thead{display:none}table.list td{display:block;border:0;padding:.1rem 0;max-width:none}
table.list tr{display:block;border-bottom:1px solid var(--rule);padding:.5rem 0}
table.list td:first-child.method{position:static;margin:0;padding-left:0}
}
@media print{
:root{--paper:#fff;--ink:#000;--muted:#555;--rule:#ccc;--shade:#eee}
body{font-size:10pt}main{max-width:none;padding:0}h2,.case{break-after:avoid}
nav,.tools{display:none!important}.wrap{overflow:visible}table{font-size:8pt}tr,.panels svg,.about{break-inside:avoid}
thead{display:table-header-group}.panels{grid-template-columns:repeat(3,1fr)}
td,td small{white-space:normal;min-width:0!important}td.method{min-width:10em!important}
}
"""
)

SCRIPT = """
(function(){
document.documentElement.classList.add('js');
var table=document.getElementById('t-orders'),q=document.getElementById('q'),ref=document.getElementById('ref');
function show(){
 if(!table)return;
 var words=q.value.toLowerCase().split(/\\s+/).filter(Boolean),head=null,any=false;
 function close(){if(head)head.hidden=!any}
 [].forEach.call(table.tBodies[0].rows,function(r){
  if(r.className==='group'){close();head=r;any=false;return}
  var text=(r.dataset.case+' '+r.textContent).toLowerCase();
  r.hidden=!words.every(function(w){return text.indexOf(w)>=0})||(!ref.checked&&r.dataset.kind==='refused');
  any=any||!r.hidden});
 close()}
if(q){q.addEventListener('input',show);ref.addEventListener('change',show)}
[].forEach.call(document.querySelectorAll('.legend li'),function(li){
 var box=li.closest('.case');
 function set(on){box.classList.toggle('dim',on);
  [].forEach.call(box.querySelectorAll('.s'+li.dataset.s),function(g){g.classList.toggle('on',on)})}
 li.addEventListener('mouseenter',function(){set(true)});li.addEventListener('mouseleave',function(){set(false)})});
addEventListener('beforeprint',function(){[].forEach.call(document.querySelectorAll('details'),function(d){d.open=true})});
})();
"""
